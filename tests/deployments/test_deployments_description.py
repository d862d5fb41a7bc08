"""What a campaign's `execution` says of containers, read into one description."""

import pytest
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.tasks.execution.description import Container, Needs, RunDescription, is_label, label_of

IMAGE = "  image: ghcr.io/me/robot:1.0\n"


def faults(described, execution, context=None):
    with pytest.raises(FileError, match=r"rooms\.vast:\d+:\d+: execution") as error:
        described(execution, context)
    return [str(fault).partition("rooms.vast:")[2] for fault in error.value.faults]


def test_every_key_is_in_the_description(described, tmp_path):
    assert described() == RunDescription(
        name="two-rooms",
        image="ghcr.io/me/robot:1.0",
        main=Container("main", Needs(cpu=4, memory_bytes=8 * 2**30, gpu=1)),
        sidecars=(Container("nav-stack"), Container("simulation", Needs(2, 512 * 2**20))),
        env={"FOO": "1", "COST": "$HOME $(FOO) $$x 'q'"},
        folder=tmp_path,
        files=("scripts/post.sh", "scripts/pre.sh", "deep/er/two words.yml"),
        pre_command="/config/scripts/pre.sh",
        post_command="/config/scripts/post.sh",
        user=1001,
        deadline_s=362,
        node_labels={"disk": "ssd", "example.org/fast": "true"},
    )


def test_image_is_enough(described, tmp_path):
    found = described(IMAGE)
    assert found == RunDescription("two-rooms", "ghcr.io/me/robot:1.0", Container("main"), folder=tmp_path)


def test_without_an_image_it_is_said_what_to_write(described):
    assert faults(described, "  runs: 2\n") == [
        "9:1: execution: no 'image'; image: container image of the system under test, such as ghcr.io/me/robot:1.0"
    ]


@each_row("image", ["''", "'my robot'"])
def test_image_without_a_name_is_refused(described, image):
    (fault,) = faults(described, f"  image: {image}\n")
    assert fault == f"10:10: execution.image: expected the name of an image, such as ghcr.io/me/robot:1.0, got {image}"


@each_row(("context", "needs"), [(None, (4, 8 * 2**30)), ("cloud", (16, 1_500_000_000))])
def test_resources_are_those_of_the_chosen_cluster(described, context, needs):
    found = described(context=context).main.needs
    assert (found.cpu, found.memory_bytes) == needs


def test_every_list_follows_the_first_cluster_that_the_file_names(described):
    needs = described(
        f"{IMAGE}  resources:\n    memory: [{{b: 2Gi}}, {{a: 1Gi}}]\n    cpu: [{{a: 1}}, {{b: 2}}]\n"
    ).main.needs
    assert needs == Needs(1, 2**30)


def test_cluster_without_resources_is_refused_at_each_list(described):
    execution = f"{IMAGE}  resources:\n    cpu: [{{edge: 4}}]\n    memory: [{{edge: 8Gi}}, {{cloud: 1Gi}}]\n"
    assert faults(described, execution, "edg") == [
        "12:10: execution.resources.cpu: nothing for the context 'edg'; did you mean 'edge'?",
        "13:13: execution.resources.memory: nothing for the context 'edg'; did you mean 'edge'?",
    ]
    assert len(faults(described, execution, "cloud")) == 1


def test_cluster_means_nothing_where_the_file_has_no_lists(described):
    assert described(f"{IMAGE}  resources: {{cpu: 3}}\n", "any").main.needs == Needs(3)


def test_amount_of_memory_that_is_none_is_refused_where_it_stands(described):
    assert faults(described, f"{IMAGE}  resources:\n    memory: [{{edge: 8GB}}]\n") == [
        "12:21: execution.resources.memory[0].edge: found '8GB'; did you mean '8Gi'?"
    ]


@each_row(
    ("written", "text"),
    [("1", "1"), ("1.10", "1.10"), ("yes", "yes"), ("1e3", "1e3"), ("'a b'", "a b"), ("", ""), ("010", "010")],
)
def test_variable_has_the_value_as_it_is_written(described, written, text):
    assert described(f"{IMAGE}  env:\n    - NAME: {written}\n").env == {"NAME": text}


def test_value_that_stands_elsewhere_is_taken_as_yaml_reads_it(described):
    assert described(f"{IMAGE}  env:\n    - A: &on true\n    - B: *on\n").env == {"A": "true", "B": "true"}


@each_row(
    ("entry", "fault"),
    [
        ("A-B: 1", "env[0].A-B: expected letters, digits and underscores, got 'A-B'"),
        ("A: [1]", "env[0].A: expected text, a number, true or false, got a list or mapping"),
        ("CONTAINER_NAME: x", "env[0].CONTAINER_NAME: CONTAINER_NAME is set for every container; another name"),
    ],
)
def test_variable_that_no_container_can_have_is_refused(described, entry, fault):
    (found,) = faults(described, f"{IMAGE}  env:\n    - {entry}\n")
    assert found.partition("execution.")[2] == fault


@each_row(
    ("names", "fault"),
    [
        ("[nav, NAV]", "a second container 'nav'; another name"),
        ("[main]", "'main' is the main container; another name"),
        ("['???']", "expected a name of letters, digits and hyphens, got '???'"),
    ],
)
def test_containers_have_names_of_their_own(described, names, fault):
    (found,) = faults(described, f"{IMAGE}  secondary_containers: {names}\n")
    assert found.endswith(fault)


def test_pattern_without_a_slash_matches_in_every_folder_and_each_file_is_there_once(described):
    assert described(f"{IMAGE}  run_files: ['*.sh', 'scripts/*', '**/pre.sh']\n").files == (
        "scripts/post.sh",
        "scripts/pre.sh",
    )


@each_row(
    ("pattern", "fault"),
    [
        ("*.txt", "expected a pattern of files below , got '*.txt', which no file matches"),
        ("../x", "expected a pattern of files below the campaign file's folder, got '../x'"),
        ("/etc/passwd", "expected a pattern of files below the campaign file's folder, got '/etc/passwd'"),
        ("a/**b", "got 'a/**b'"),  # a pattern since Python 3.13
        ("", "expected a pattern such as scripts/*.sh or **/*.yaml, got ''"),
    ],
)
def test_pattern_that_gives_no_files_is_refused(described, pattern, fault):
    (found,) = faults(described, f"{IMAGE}  run_files: ['{pattern}']\n")
    assert found.startswith(f"11:15: execution.run_files[0]: {fault}")


@each_row("label", ["'a b': x", "a: 'b c'", "a: [b]", "-a: b"])
def test_label_that_no_node_can_have_is_refused(described, label):
    (found,) = faults(described, f"{IMAGE}  kubernetes: {{jobs: {{node_labels: {{{label}}}}}}}\n")
    assert "execution.kubernetes.jobs.node_labels." in found


def test_all_faults_are_said_at_once(described):
    execution = "  resources: {memory: much}\n  secondary_containers: [main]\n  env: [{1: 2}]\n  run_files: [none]\n"
    assert [fault.partition(":")[0] for fault in faults(described, execution)] == ["9", "10", "11", "12", "13"]


def test_image_is_told_the_scripts_and_a_command_is_wrapped_in_them(described):
    found = described()
    assert found.command_of(found.main) == ()
    assert found.environment_of(found.main)["PRE_COMMAND"] == "/config/scripts/pre.sh"
    with_command = RunDescription("x", "i", Container("main", command=("run", "a b")), pre_command="/p.sh")
    assert with_command.command_of(with_command.main) == ("/bin/bash", "-c", ". /p.sh || exit\nexec run 'a b'")
    assert "PRE_COMMAND" not in with_command.environment_of(with_command.main)


def test_scripts_are_the_main_containers_alone(described):
    found = described()
    environment = found.environment_of(found.sidecars[0])
    assert "PRE_COMMAND" not in environment
    assert environment["CONTAINER_NAME"] == "nav-stack"
    assert environment["ROS_LOG_DIR"] == "/vastflow/out/logs/nav-stack"


@each_row("name", ["", "-a", "a_b", "A", "x" * 64])
def test_name_that_is_no_dns_label_is_refused(name):
    with pytest.raises(ValueError, match="at most 63 lowercase letters, digits and hyphens"):
        Container(name)
    with pytest.raises(ValueError, match="at most 63 lowercase letters, digits and hyphens"):
        RunDescription(name, "image", Container("main"))


def test_two_containers_of_one_name_are_refused():
    with pytest.raises(ValueError, match="got two containers 'main'"):
        RunDescription("x", "image", Container("main"), (Container("main"),))


@each_row("text", ["Nav Stack", "_nav_", "x" * 62 + "-y", "Ä1", "nav"])
def test_label_is_made_of_any_name_with_a_letter_or_digit(text):
    assert is_label(label_of(text))
