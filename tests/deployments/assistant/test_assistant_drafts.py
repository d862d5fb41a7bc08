"""Campaign files of an assistant: planned, refused, and run with permission alone."""

import time
from pathlib import Path

import pytest
from explored import write_explored
from hostile import executed, touching
from synthetic import walled_room, write_map
from table import each_row

from vastflow.deployments.assistant import drafts as module
from vastflow.deployments.assistant.answers import Answers
from vastflow.deployments.assistant.drafts import Drafts
from vastflow.deployments.explorer.directories import Directories
from vastflow.sim.model.faults import UserError

CAMPAIGN = """\
version: 1
metadata: {{name: drafted}}
configuration:
  - name: room
    parameters: [map_file: {map}, start_pose: {{x: 1.0, y: 2.0}}, goal_pose: {{x: 5.0, y: 2.0}}]
    variations:
      - ParameterVariationList: {{name: laserscan_gaussian_noise_std_deviation, values: [0.0, 0.01, 0.02]}}
execution: {{runs: 2, timeout: 1}}
"""


@pytest.fixture
def workspace(tmp_path) -> Path:
    folder = tmp_path / "workspace"
    folder.mkdir()
    write_map(folder / "room", walled_room(6.0, 4.0))
    return folder


@pytest.fixture
def drafted(tmp_path, workspace, monkeypatch):
    """Makes drafts in a workspace, with a store of their own; `results` if they may run."""
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    made = []

    def drafts(results=None):
        answers = Answers(Directories([results or tmp_path]))
        made.append(Drafts(answers.directory, workspace, results))
        return made[-1]

    yield drafts
    for each in made:
        each.close()


def map_in(folder):
    return next(each.relative_to(folder).as_posix() for each in sorted(folder.rglob("*.yaml")))


@pytest.mark.timeout(300)
def test_plan_counts_configurations_and_runs(drafted, workspace):
    found = drafted().plan_campaign(CAMPAIGN.format(map=map_in(workspace)))
    assert (found["valid"], found["faults"]) == (True, [])
    assert (found["configurations"], found["runs"], found["runs_in_all"]) == (3, 2, 6)
    assert found["families"]["room"]["realized"] == 3
    assert drafted().plan_campaign(CAMPAIGN.format(map=map_in(workspace)), runs=7)["runs_in_all"] == 21


@pytest.mark.timeout(300)
def test_plan_reports_faults_with_their_places(drafted, workspace):
    text = CAMPAIGN.format(map=map_in(workspace)).replace("runs: 2", "runs: five")
    found = drafted().plan_campaign(text)
    assert not found["valid"]
    (fault,) = found["faults"]
    assert fault.startswith("campaign.vast:8:")
    assert "five" in fault


@pytest.mark.timeout(300)
def test_plan_refuses_code_of_the_text_and_executes_none(drafted, workspace, tmp_path):
    canary = tmp_path / "canary"
    (workspace / "own.py").write_text(touching(canary) + "class Own: ...\n")
    text = CAMPAIGN.format(map=map_in(workspace)).replace("ParameterVariationList: {", "own.py:Own: {")
    found = drafted().plan_campaign(text)
    assert not found["valid"]
    assert "own.py" in found["faults"][0]
    assert "Permit it by --allow-run" in " ".join(found["faults"])
    assert not canary.exists()
    (tmp_path / "results").mkdir()
    drafted(tmp_path / "results").plan_campaign(text)
    assert executed(canary)


@each_row(
    "name",
    [
        "/etc/passwd",
        "../secret.yaml",
        "room/../../secret.yaml",
        "~/secret.yaml",
        "linked.yaml",
        "linked/secret.yaml",
        "../secret.py:Own",
        '"\\x2fetc/passwd"',
        "file:///etc/passwd",
        "/tmp",
    ],
)
def test_plan_refuses_names_outside_of_the_workspace(drafted, workspace, tmp_path, name):
    outside = workspace.parent
    (outside / "secret.yaml").write_text("secret")
    for link, target in (("linked.yaml", outside / "secret.yaml"), ("linked", outside)):
        if not (workspace / link).is_symlink():
            (workspace / link).symlink_to(target)
    with pytest.raises(UserError, match="expected names of files in the workspace, got"):
        drafted().plan_campaign(CAMPAIGN.format(map=name))
    with pytest.raises(UserError, match="expected names of files in the workspace, got"):
        drafted().plan_campaign(CAMPAIGN.format(map=map_in(workspace)) + f"other: [a, {{b: {name}}}]\n")


@pytest.mark.timeout(300)
def test_plan_names_the_input_files_of_a_campaign(drafted, workspace, tmp_path):
    room = write_map(tmp_path / "room", walled_room(6.0, 4.0))
    (tmp_path / "found").mkdir()
    directory = write_explored(tmp_path / "found", room, 28, {"room": [1]})
    map = map_in(workspace)
    for each in sorted((workspace / map).parent.iterdir()):
        target = directory / "inputs" / "maps" / each.name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(each.read_bytes())
    (id,) = [each.id for each in Directories([tmp_path / "found"]).all()]
    drafts = Drafts(Answers(Directories([tmp_path / "found"])).directory, None, None)
    found = drafts.plan_campaign(CAMPAIGN.format(map=f"maps/{Path(map).name}"), files_of=id)
    drafts.close()
    assert (found["valid"], found["configurations"]) == (True, 3)


@pytest.mark.timeout(120)
def test_plan_that_takes_too_long_is_ended(drafted, workspace, monkeypatch):
    monkeypatch.setattr(module, "WALL_S", 0.05)
    with pytest.raises(UserError, match=r"plan: its process took more than 0\.05 s\. Ask for less\."):
        drafted().plan_campaign(CAMPAIGN.format(map=map_in(workspace)))


def test_draft_refuses_text_without_yaml(drafted):
    with pytest.raises(UserError, match="expected a campaign file in YAML"):
        drafted().plan_campaign("a: [1, 2")


@pytest.mark.timeout(300)
def test_large_campaign_is_not_run(drafted, workspace, tmp_path):
    (tmp_path / "results").mkdir()
    drafts = drafted(tmp_path / "results")
    with pytest.raises(UserError, match=r"at most 2,000 runs of all configurations together, got 6,000"):
        drafts.run_campaign(CAMPAIGN.format(map=map_in(workspace)), runs=2000)
    assert [*(tmp_path / "results").iterdir()] == []


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_small_campaign_runs_in_the_background(drafted, workspace, tmp_path):
    (tmp_path / "results").mkdir()
    drafts = drafted(tmp_path / "results")
    assert drafts.run_campaign(CAMPAIGN.format(map=map_in(workspace)))["runs_in_all"] == 6
    with pytest.raises(UserError, match="still running"):
        drafts.run_campaign(CAMPAIGN.format(map=map_in(workspace)))
    assert drafts._process.wait(500) == 0
    row = Answers(Directories([tmp_path / "results"])).rates()["whole"]
    assert row["passed"] + row["failed"] + row["not_judged"] == 6


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_run_ends_with_the_server(drafted, workspace, tmp_path):
    (tmp_path / "results").mkdir()
    drafts = drafted(tmp_path / "results")
    drafts.run_campaign(CAMPAIGN.format(map=map_in(workspace)), runs=600)
    folder, process = Path(drafts._folder.name), drafts._process
    assert process.poll() is None
    began_s = time.monotonic()
    drafts.close()
    assert time.monotonic() - began_s < 60
    assert process.poll() is not None
    assert not folder.exists()
