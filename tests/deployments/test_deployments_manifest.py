"""Manifests as YAML: read back equal, and literal variables."""

import re

import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from table import each_row

from vastflow.tasks.prefect.manifests import literal_variables, yaml_text

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


def expanded(text):
    """Expand a text as Kubernetes does: a doubled dollar is one dollar."""
    assert re.search(r"(?<!\$)(\$\$)*\$(?!\$)", text) is None
    return text.replace("$$", "$")


@given(st.text())
def test_literal_variables_hide_dollars_from_kubernetes(value):
    (variable,) = literal_variables({"NAME": value})
    assert expanded(variable["value"]) == value


@example({"\n\x85": ""})
@given(st.dictionaries(TEXT, TEXT | st.lists(TEXT) | st.booleans() | st.integers()))
def test_yaml_loads_back_equal(manifest):
    assert yaml.safe_load(yaml_text(manifest)) == manifest


@each_row("text", ["1", "1e3", "0o17", "0x1F", "012", "y", "no", "On", "~", "null", ".inf", "12:30", "a: b", ""])
def test_text_is_never_converted(text):
    written = yaml_text({"key": text})
    assert yaml.safe_load(written) == {"key": text}
    # Readers of YAML 1.2 have other rules for plain text, and the same for quotes.
    assert written.partition(": ")[2][0] in "'\""


def test_script_is_written_line_by_line():
    assert yaml_text({"script": "a\nb 'c'"}) == "script: |-\n  a\n  b 'c'\n"
