"""`vastflow deploy --format`: what it prints where, and its exit codes."""

import re
import shlex
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.flows.cli.deploy import MOST_IN_A_CONFIG_MAP
from vastflow.producers.campaign_file.spec import ExecutionSpec
from vastflow.tasks.execution.manifests import compose_file, config_map_keys, pod_template

ROOT = Path(__file__).parents[2]
IMAGE = "  image: ghcr.io/me/robot:1.0\n"


def called(*arguments):
    return CliRunner().invoke(app, ["deploy", *map(str, arguments)])


@pytest.fixture
def full(described, tmp_path):
    """The file with every key, and its description."""
    found = described()
    return tmp_path / "rooms.vast", found


def test_file_for_compose_is_printed_and_what_it_leaves_out_is_said(full):
    file, description = full
    result = called(file, "--format", "compose")
    assert result.exit_code == 0
    assert yaml.safe_load(result.stdout) == compose_file(description)
    assert [line.split(":")[0] for line in result.stderr.splitlines()] == [
        f"save it in {file.parent}; make a folder ./out there that user 1001 can write to",
        "execution.timeout",
        "execution.kubernetes.jobs.node_labels",
    ]


def test_pod_is_printed_and_how_to_make_its_files(full):
    file, description = full
    result = called(file, "--format", "kubernetes")
    assert result.exit_code == 0
    assert yaml.safe_load(result.stdout) == pod_template(description)
    (note,) = result.stderr.splitlines()
    command = shlex.split(note.partition("make it by: ")[2])
    assert command[:4] == ["kubectl", "create", "configmap", "two-rooms-files"]
    keys = config_map_keys(description)
    assert command[4:] == [f"--from-file={key}={file.parent / name}" for key, name in keys.items()]


def test_resources_of_a_cluster_can_be_asked_for(full):
    result = called(full[0], "--format", "kubernetes", "--context", "cloud")
    (main,) = yaml.safe_load(result.stdout)["template"]["spec"]["containers"]
    assert main["resources"]["requests"] == {"cpu": "16", "memory": "1500000000"}


def test_files_that_no_config_map_holds_are_warned_of(campaign_file, tmp_path):
    (tmp_path / "big.bin").write_bytes(bytes(MOST_IN_A_CONFIG_MAP + 1))
    result = called(campaign_file(f"{IMAGE}  run_files: [big.bin]\n"), "--format", "kubernetes")
    assert result.exit_code == 0
    assert result.stderr.splitlines()[1].startswith(
        "execution.run_files: expected a ConfigMap holds , got 1048577 bytes"
    )


@pytest.mark.parametrize(
    ("execution", "context", "said"),
    [
        ("  runs: 2\n", [], "9:1: execution: no 'image'; image: container image of the system under test"),
        (f"{IMAGE}  resources: {{cpu: [{{a: 1}}]}}\n", ["--context", "b"], "nothing for the context 'b'; known: a"),
        ("  rums: 2\n", [], "unknown key 'rums'; did you mean 'runs'?"),
    ],
)
@pytest.mark.parametrize("format_", ["compose", "kubernetes"])
def test_what_can_not_be_described_is_said_and_exits_with_2(campaign_file, execution, context, said, format_):
    result = called(campaign_file(execution), "--format", format_, *context)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("arguments", [[], ["--format", "helm"]])
def test_format_has_to_be_named(full, arguments):
    result = called(full[0], *arguments)
    assert (result.exit_code, result.stdout) == (2, "")


@pytest.mark.parametrize("format_", ["compose", "kubernetes"])
def test_example_of_the_page_can_be_described(campaign_file, format_):
    page = (ROOT / "docs" / "describe-the-execution.md").read_text()
    example = page.partition("```yaml\nexecution:\n")[2].partition("```")[0]
    result = called(campaign_file(example), "--format", format_)
    assert (result.exit_code, bool(result.stdout)) == (0, True), result.stderr


def test_page_names_every_key_that_is_used_or_is_not():
    page = (ROOT / "docs" / "describe-the-execution.md").read_text()
    table = page.partition("| key of `execution` |")[2].partition("\n\n")[0]
    cells = [row.split("|")[1] for row in table.splitlines()[2:]]
    named = {key.partition(".")[0] for cell in cells for key in re.findall(r"`([\w.]+)`", cell)}
    in_sentences = {"pre_command", "post_command", "runs_per_job"}
    of_the_simulator = {"scenario_file", "nav2_params"}
    assert named | in_sentences | of_the_simulator == set(ExecutionSpec.model_fields)
