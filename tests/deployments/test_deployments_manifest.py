"""Manifests as YAML, for readers of YAML 1.1 and 1.2."""

import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from table import each_row

from vastflow.tasks.execution.manifests import compose_file, pod_template, yaml_text

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


@example({"\n\x85": ""})
@given(st.dictionaries(TEXT, TEXT | st.lists(TEXT) | st.booleans() | st.integers()))
def test_what_is_written_loads_back_equal(manifest):
    assert yaml.safe_load(yaml_text(manifest)) == manifest


@each_row("text", ["1", "1e3", "0o17", "0x1F", "012", "y", "no", "On", "~", "null", ".inf", "12:30", "a: b", ""])
def test_text_stays_text_to_every_reader(text):
    written = yaml_text({"key": text})
    assert yaml.safe_load(written) == {"key": text}
    # Readers of YAML 1.2 have other rules for plain text, and the same for quotes.
    assert written.partition(": ")[2][0] in "'\""


def test_manifests_load_back_equal_and_have_no_aliases(described):
    for manifest in (compose_file(described()), pod_template(described())):
        written = yaml_text(manifest)
        assert yaml.safe_load(written) == manifest
        assert "&id" not in written


def test_script_is_written_line_by_line():
    assert yaml_text({"script": "a\nb 'c'"}) == "script: |-\n  a\n  b 'c'\n"
