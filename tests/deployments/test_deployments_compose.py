"""Run descriptions as Docker Compose files: valid by Compose's own schema, and what they say."""

from dataclasses import replace
from string import Template

import jsonschema
import pytest
from check_jsonschema.builtin_schemas import get_builtin_schema
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.tasks.execution.description import Container, Needs, RunDescription
from vastflow.tasks.execution.manifests import compose_file

SCHEMA = get_builtin_schema("vendor.compose-spec")
ALONE = RunDescription("x", "image", Container("main"))


def validate(file):
    jsonschema.validate(file, SCHEMA, jsonschema.Draft202012Validator)


def test_file_is_valid(described):
    validate(compose_file(described()))


def test_file_of_a_single_container_is_valid():
    validate(compose_file(ALONE))


def test_schema_refuses_what_compose_does_not_know(described):
    file = compose_file(described())
    file["services"]["main"]["comand"] = ["x"]
    with pytest.raises(jsonschema.ValidationError, match="comand"):
        validate(file)


def test_main_container_starts_last_and_all_share_network_and_memory(described):
    services = compose_file(described())["services"]
    assert list(services) == ["nav-stack", "simulation", "main"]
    assert services["main"]["depends_on"] == ["nav-stack", "simulation"]
    assert (services["nav-stack"]["ipc"], services["nav-stack"]["shm_size"]) == ("shareable", "512m")
    for name in ("simulation", "main"):
        assert services[name]["ipc"] == services[name]["network_mode"] == "service:nav-stack"


def test_single_container_joins_nobody(described):
    (main,) = compose_file(ALONE)["services"].values()
    assert {"network_mode", "depends_on", "deploy", "entrypoint"}.isdisjoint(main)


def test_every_container_has_the_two_shared_folders_and_the_files(described):
    for service in compose_file(described())["services"].values():
        assert [(mount["source"], mount["target"], mount.get("read_only", False)) for mount in service["volumes"]] == [
            ("./out", "/vastflow/out", False),
            ("sockets", "/vastflow/sockets", False),
            ("./scripts/post.sh", "/config/scripts/post.sh", True),
            ("./scripts/pre.sh", "/config/scripts/pre.sh", True),
            ("./deep/er/two words.yml", "/config/deep/er/two words.yml", True),
        ]


def test_memory_is_reserved_and_limited_and_cores_are_reserved(described):
    services = compose_file(described())["services"]
    assert services["simulation"]["deploy"]["resources"] == {
        "reservations": {"cpus": "2", "memory": "512m"},
        "limits": {"memory": "512m"},
    }
    (gpu,) = services["main"]["deploy"]["resources"]["reservations"]["devices"]
    assert gpu == {"driver": "nvidia", "count": 1, "capabilities": ["gpu"]}
    assert "deploy" not in services["nav-stack"]


def test_gpu_alone_is_valid():
    validate(compose_file(replace(ALONE, main=Container("main", Needs(gpu=2)))))


@each_row(("user", "restricted"), [(0, False), (1001, True)])
def test_root_alone_keeps_its_capabilities(user, restricted):
    file = compose_file(replace(ALONE, user=user))
    main = file["services"]["main"]
    assert main["user"] == str(user)
    assert ("cap_drop" in main, "security_opt" in main) == (restricted, restricted)
    assert file["volumes"]["sockets"]["driver_opts"]["o"] == f"uid={user},mode=0770"


@given(st.text(), st.lists(st.text(), min_size=1))
def test_no_dollar_is_taken_for_a_variable_of_composes(value, command):
    description = replace(ALONE, env={"NAME": value}, main=Container("main", command=tuple(command)))
    main = compose_file(description)["services"]["main"]
    assert Template(main["environment"]["NAME"]).substitute() == value
    assert [Template(argument).substitute() for argument in main["entrypoint"]] == command


def test_command_stands_between_the_scripts():
    main = Container("main", command=("run", "a b"))
    entrypoint = compose_file(replace(ALONE, main=main, post_command="/post.sh"))["services"]["main"]["entrypoint"]
    assert entrypoint[:2] == ["/bin/bash", "-c"]
    assert "run 'a b' &\nwait $$!\n" in entrypoint[2]
