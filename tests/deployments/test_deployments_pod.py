"""Run descriptions as pods: valid by Kubernetes' own schemas, and what they say."""

import re
from dataclasses import replace

import kubernetes_validate
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.tasks.execution.description import Container, Needs, RunDescription
from vastflow.tasks.execution.manifests import config_map_keys, pod_spec, pod_template

SIDECARS_SINCE = "1.29"
VERSIONS = [SIDECARS_SINCE, kubernetes_validate.latest_version()]
ALONE = RunDescription("x", "image", Container("main"))


def validate(manifest, version=VERSIONS[-1]):
    kubernetes_validate.validate(manifest, version, strict=True)


@each_row("version", VERSIONS)
def test_template_is_valid_and_so_are_a_pod_and_a_job_of_it(described, version):
    template = pod_template(described())
    validate(template, version)
    validate({"apiVersion": "v1", "kind": "Pod", "metadata": template["metadata"], **template["template"]}, version)
    job = {"metadata": template["metadata"], "spec": {"template": template["template"]}}
    validate({"apiVersion": "batch/v1", "kind": "Job", **job}, version)


def test_template_of_a_single_container_is_valid():
    validate(pod_template(ALONE))


def test_schema_refuses_what_kubernetes_does_not_know(described):
    template = pod_template(described())
    template["template"]["spec"]["containers"][0]["comand"] = ["x"]
    with pytest.raises(kubernetes_validate.ValidationError, match="comand"):
        validate(template)


def test_sidecars_start_before_the_main_container_and_the_pod_ends_with_it(described):
    spec = pod_spec(described())
    assert spec["restartPolicy"] == "Never"
    assert [container["name"] for container in spec["containers"]] == ["main"]
    assert [(container["name"], container["restartPolicy"]) for container in spec["initContainers"]] == [
        ("nav-stack", "Always"),
        ("simulation", "Always"),
    ]


def test_pod_gets_nothing_of_the_cluster(described):
    spec = pod_spec(described())
    assert (spec["automountServiceAccountToken"], spec["enableServiceLinks"]) == (False, False)


@each_row(("user", "restricted"), [(0, False), (1001, True)])
def test_pod_is_roots_only_where_the_file_says_so(user, restricted):
    spec = pod_spec(replace(ALONE, user=user))
    assert (spec["securityContext"]["runAsUser"], spec["securityContext"]["runAsNonRoot"]) == (user, restricted)
    assert ("securityContext" in spec["containers"][0]) == restricted


def test_requests_are_the_files_and_memory_alone_is_limited(described):
    spec = pod_spec(described())
    assert spec["containers"][0]["resources"] == {
        "requests": {"cpu": "4", "memory": "8Gi"},
        "limits": {"memory": "8Gi", "nvidia.com/gpu": "1"},
    }
    assert "resources" not in spec["initContainers"][0]


def test_gpu_alone_is_valid():
    validate(pod_template(replace(ALONE, main=Container("main", Needs(gpu=2)))))


def test_only_a_timeout_of_the_file_is_a_deadline(described):
    assert pod_spec(described())["activeDeadlineSeconds"] == 362
    assert "activeDeadlineSeconds" not in pod_spec(ALONE)


def test_node_labels_choose_the_node(described):
    assert pod_spec(described())["nodeSelector"] == {"disk": "ssd", "example.org/fast": "true"}
    assert "nodeSelector" not in pod_spec(ALONE)


def test_every_container_mounts_every_volume(described):
    spec = pod_spec(described())
    volumes = [volume["name"] for volume in spec["volumes"]]
    assert volumes == ["out", "sockets", "shared-memory", "config"]
    for container in (*spec["initContainers"], *spec["containers"]):
        mounts = {mount["name"]: mount["mountPath"] for mount in container["volumeMounts"]}
        assert list(mounts) == volumes
        assert list(mounts.values()) == ["/vastflow/out", "/vastflow/sockets", "/dev/shm", "/config"]
    assert spec["volumes"][2]["emptyDir"] == {"medium": "Memory", "sizeLimit": "512Mi"}


def test_files_come_from_a_config_map_to_their_places(described):
    found = described()
    source = pod_spec(found)["volumes"][3]["configMap"]
    assert source["name"] == "two-rooms-files"
    assert source["items"] == [{"key": key, "path": file} for key, file in config_map_keys(found).items()]
    assert config_map_keys(found) == {
        "0-post.sh": "scripts/post.sh",
        "1-pre.sh": "scripts/pre.sh",
        "2-two_words.yml": "deep/er/two words.yml",
    }


@given(st.lists(st.text(min_size=1, max_size=20), unique=True))
def test_keys_of_a_config_map_are_valid_and_distinct(files):
    keys = config_map_keys(replace(ALONE, files=tuple(files)))
    assert list(keys.values()) == files
    assert all(re.fullmatch(r"[-._a-zA-Z0-9]{1,253}", key) for key in keys)


def expanded(text):
    """What Kubernetes makes of a text: a doubled dollar is one, and stands for nothing."""
    assert re.search(r"(?<!\$)(\$\$)*\$(?!\$)", text) is None
    return text.replace("$$", "$")


@given(st.text(), st.lists(st.text(), min_size=1))
def test_no_dollar_is_taken_for_a_variable_of_kubernetes(value, command):
    description = replace(ALONE, env={"NAME": value}, main=Container("main", command=tuple(command)))
    (main,) = pod_spec(description)["containers"]
    assert expanded(main["env"][0]["value"]) == value
    assert [expanded(argument) for argument in main["command"]] == command
