"""Manifests for Docker Compose and Kubernetes: golden files, valid by the platforms' own schemas."""

import re
from dataclasses import replace
from pathlib import Path
from string import Template

import jsonschema
import kubernetes_validate
import pytest
import yaml
from check_jsonschema.builtin_schemas import get_builtin_schema
from hypothesis import example, given
from hypothesis import strategies as st
from table import each_row

from vastflow.tasks.prefect.containers import Container, Needs, RunDescription
from vastflow.tasks.prefect.manifests import compose_file, config_map_items, pod_spec, pod_template, yaml_text

COMPOSE = get_builtin_schema("vendor.compose-spec")
SIDECARS_SINCE = "1.29"
VERSIONS = [SIDECARS_SINCE, kubernetes_validate.latest_version()]
ALONE = RunDescription("x", "image", Container("main"))
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


def validate_compose(file):
    jsonschema.validate(file, COMPOSE, jsonschema.Draft202012Validator)


def validate(manifest, version=VERSIONS[-1]):
    kubernetes_validate.validate(manifest, version, strict=True)


@each_row("made", [compose_file, pod_template])
def test_manifest_of_every_key_is_as_in_golden_file(described, request, made):
    file = Path(__file__).parent / f"{made.__name__}.yaml"
    manifest = made(described())
    written = yaml_text(manifest)
    assert yaml.safe_load(written) == manifest and "&id" not in written
    if request.config.getoption("update_golden"):
        file.write_text(written)
    assert written == file.read_text()


@each_row("version", VERSIONS)
def test_pod_template_and_pod_and_job_of_it_are_valid(described, version):
    template = pod_template(described())
    validate(template, version)
    validate({"apiVersion": "v1", "kind": "Pod", "metadata": template["metadata"], **template["template"]}, version)
    job = {"metadata": template["metadata"], "spec": {"template": template["template"]}}
    validate({"apiVersion": "batch/v1", "kind": "Job", **job}, version)
    template["template"]["spec"]["containers"][0]["comand"] = ["x"]
    with pytest.raises(kubernetes_validate.ValidationError, match="comand"):
        validate(template, version)


def test_compose_file_is_valid(described):
    file = compose_file(described())
    validate_compose(file)
    file["services"]["main"]["comand"] = ["x"]
    with pytest.raises(jsonschema.ValidationError, match="comand"):
        validate_compose(file)


@each_row("description", [ALONE, replace(ALONE, main=Container("main", Needs(gpu=2)))])
def test_manifests_of_single_container_are_valid(description):
    validate(pod_template(description))
    validate_compose(compose_file(description))


def test_single_container_has_no_key_of_others():
    (main,) = compose_file(ALONE)["services"].values()
    assert {"network_mode", "depends_on", "deploy"}.isdisjoint(main)
    assert {"activeDeadlineSeconds", "nodeSelector", "initContainers"}.isdisjoint(pod_spec(ALONE))


@each_row(("user", "restricted"), [(0, False), (1001, True)])
def test_capabilities_are_kept_by_root(user, restricted):
    spec = pod_spec(replace(ALONE, user=user))
    assert (spec["securityContext"]["runAsUser"], spec["securityContext"]["runAsNonRoot"]) == (user, restricted)
    assert ("securityContext" in spec["containers"][0]) == restricted
    file = compose_file(replace(ALONE, user=user))
    main = file["services"]["main"]
    assert (main["user"], "cap_drop" in main, "security_opt" in main) == (str(user), restricted, restricted)
    assert file["volumes"]["sockets"]["driver_opts"]["o"] == f"uid={user},mode=0770"


@given(st.lists(st.text(min_size=1, max_size=20), unique=True))
def test_keys_of_config_map_are_valid_and_distinct(files):
    items = config_map_items(replace(ALONE, files=tuple(files)))
    assert [each["path"] for each in items] == files
    keys = {each["key"] for each in items}
    assert len(keys) == len(files) and all(re.fullmatch(r"[-._a-zA-Z0-9]{1,253}", key) for key in keys)


def expanded(text):
    """Expand a text as Kubernetes does: a doubled dollar is one dollar."""
    assert re.search(r"(?<!\$)(\$\$)*\$(?!\$)", text) is None
    return text.replace("$$", "$")


@given(st.text())
def test_manifests_hide_dollars_from_kubernetes_and_compose(value):
    description = replace(ALONE, env={"NAME": value})
    (main,) = pod_spec(description)["containers"]
    assert expanded(main["env"][0]["value"]) == value
    main = compose_file(description)["services"]["main"]
    assert Template(main["environment"]["NAME"]).substitute() == value


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
