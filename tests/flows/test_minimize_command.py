"""`vastflow minimize`: a failing configuration becomes a campaign file of its own that still fails, and the rest is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import minimize as planted
import pytest
import yaml
from command_line import called, refused
from PIL import Image
from table import each_row

from vastflow.flows import run_campaign
from vastflow.flows.analysis.candidate_file import candidate_files, placed
from vastflow.flows.analysis.failing import Failing, _subject
from vastflow.flows.analysis.minimize import Trials, minimize_configuration
from vastflow.flows.run.computing import Computing
from vastflow.oracles.results.executed import KeptFiles
from vastflow.producers.minimization.circumstance import Subject
from vastflow.producers.minimization.minimize import Candidate, NotBuilt, Outcome
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.system.spelled_out import assumed_keys, spelled_out
from vastflow.sim.plug_ins.snapshot import snapshot_of
from vastflow.sim.reading.movers import movers_of
from vastflow.sim.system.keys import FILE_KEY
from vastflow.sim.world.world import map_content, world_content

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"

pytestmark = pytest.mark.timeout(900)

ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


class Own(Oracle[Parameters]):
    \"\"\"Has no opinion where a box is called so.\"\"\"

    Parameters = Parameters
    metrics = {}

    def judge(self, trace, situation):
        if any(each.name == "odd" for each in situation.obstacles):
            raise ZeroDivisionError("odd")
        return self.passed(trace)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a store and a campaign directory of plants that fail, pass, can't be built, and break."""
    folder = tmp_path_factory.mktemp("minimize")
    near = {"start_pose": planted.START, "goal_pose": {"x": 1.8, "y": 2.5, "yaw": 0.0}}
    boxes = [planted.box("door", 3.0, 2.5, 1.0), planted.box("a", 1.5, 0.6), planted.box("b", 4.4, 4.4)]
    blocked = {"start_pose": planted.START, "goal_pose": planted.GOAL, "static_objects": boxes, planted.NOISE: 0.02}
    plants = [
        planted.Plant("blocked", blocked, frozenset(["obstacle door"])),
        planted.Plant("easy", near, frozenset()),
        planted.Plant("in-the-wall", {**near, "start_pose": {"x": 0.05, "y": 0.05}}, frozenset()),
        planted.Plant("odd", {**near, "static_objects": [planted.box("odd", 4.4, 4.4)]}, frozenset()),
    ]
    file = planted.written(folder, plants)
    (folder / "own.py").write_text(ORACLE)
    text = file.read_text().replace(f"timeout: {planted.TIMEOUT_S}", "timeout: 20")
    file.write_text(text + "evaluation: {oracles: [own.py:Own]}\n")
    directory = run_campaign(file, results=folder / "results", store=folder / "store").directory
    return folder, directory


@pytest.mark.slow
def test_minimize_accepts_point_of_search(place):
    """The search is among two starts behind a blocked door, one of them in the wall."""
    folder, directory = place
    text = (folder / "planted.vast").read_text()
    blocked = yaml.safe_load(text)["configuration"][0]["parameters"]
    starts = [planted.START, {"x": 0.05, "y": 0.05}]
    search = {"strategy": "random", "seed": 0, "per_batch": 2, "budget": [{"batches": 1}], "confirm": 0}
    search["search_space"] = {"start": {"type": "choice", "values": starts}}
    search["parameters"] = [*(each for each in blocked if "start_pose" not in each), {"start_pose": "$start"}]
    data = {key: value for key, value in yaml.safe_load(text).items() if key != "configuration"}
    (folder / "searched.vast").write_text(yaml.safe_dump({**data, "search": search}, sort_keys=False))
    searched = run_campaign(folder / "searched.vast", results=folder / "results", store=folder / "store").directory
    listed = minimize_configuration(directory, "blocked", store=folder / "store")
    found = minimize_configuration(searched, "point-0002", store=folder / "store")
    assert [each.text for each in found.minimum.cause] == ["obstacle door at (3.00, 2.50)"]
    assert (found.executed, found.runs) == (0, listed.runs)
    said = refused("minimize", searched, "point-0001", "--store", folder / "store")
    assert "got point-0001, which was rejected: " in said


@pytest.fixture
def alone(monkeypatch):
    """Computes without Prefect; of the list, the first number is how many rounds come before an interrupt."""
    rounds = []

    def flow(run, body):
        def wait(shards, *stages):
            if rounds:
                rounds[0] -= 1
                if rounds[0] == 0:
                    raise KeyboardInterrupt

        def made(stage, shards, *before):
            work = getattr(run.engine, stage)
            return [work(each.configurations, *rows).made for each, *rows in zip(shards, *before, strict=True)]

        body(SimpleNamespace(wait=wait, map=made))

    monkeypatch.setattr(Computing, "run_alone", flow)
    return rounds


@pytest.fixture
def failing(tmp_path):
    """Returns a failing configuration with these values of its system, and its whole candidate."""
    planted.written(tmp_path, [])

    def failing(system, **execution):
        task = {"start_pose": planted.START, "goal_pose": planted.GOAL}
        values = {"map_file": map_content(tmp_path / "rooms.yaml"), **task, **system}
        tags = {"map_file": "environment", **dict.fromkeys(task, "task"), **dict.fromkeys(system, "system")}
        campaign = {"execution": execution}
        made = Failing(tmp_path, "own", "success", Subject(values, tags), campaign, {}, "footprint")
        return made, Candidate(frozenset(each for each in made.subject.circumstances if each.can_be_left_out))

    return failing


def test_minimize_leaves_planted_cause_in_campaign_that_fails(place, monkeypatch):
    folder, directory = place
    printed = called("minimize", directory, "blocked", "--store", folder / "store").output
    assert "removed: 3 values\n  obstacle a at (1.50, 0.60)\n" in printed
    asked = called("minimize", directory, "blocked", "--store", folder / "store", "--json")
    assert asked.exit_code == 0, asked.output
    said = json.loads(asked.stdout)
    assert [each["what"] for each in said["cause"]] == ["obstacle door at (3.00, 2.50)"]
    assert (said["oracle"], said["confirmed"]["failed"]) == ("success", said["confirmed"]["runs"])
    file, picture = map(Path, said["files"])
    assert file.parent == directory / "minimized" / "blocked"
    with Image.open(picture) as drawn:
        assert drawn.width > drawn.height
    again = run_campaign(file, results=folder / "again", store=folder / "store")
    assert (again.summary.executed, again.summary.failed, again.summary.passed) == (0, again.summary.runs, 0)
    monkeypatch.setattr(Computing, "run_alone", None)  # nothing is started a second time
    second = minimize_configuration(directory, "blocked", store=folder / "store")
    assert (second.executed, second.text, second.runs) == (0, file.read_text(), said["runs"])


@pytest.mark.slow
def test_interrupted_minimization_resumes_to_same_result(place, alone, tmp_path):
    folder, directory = place
    whole = minimize_configuration(directory, "blocked", store=folder / "store")
    for rounds in (1, 4):
        alone[:] = [rounds]
        with pytest.raises(KeyboardInterrupt):
            minimize_configuration(directory, "blocked", store=tmp_path, workers=1)
    alone.clear()
    found = minimize_configuration(directory, "blocked", store=tmp_path, workers=2)
    assert (found.text, found.runs, found.minimum.tried) == (whole.text, whole.runs, whole.minimum.tried)
    assert found.executed < found.runs


@pytest.mark.slow
@each_row(
    ("arguments", "said"),
    [
        ("nowhere", "Unknown configuration 'nowhere'. Expected one of blocked, easy, odd"),
        ("easy", "easy: expected a failure rate of 0.5 or more, got 0 of 3 runs by success"),
        ("in-the-wall", "got in-the-wall, which was rejected: "),
        ("odd", "runs of odd broke: fault in judge: ZeroDivisionError: odd"),
        ("blocked --oracle nobody", "--oracle: No oracle 'nobody' judged blocked"),
    ],
)
def test_minimize_refuses_passing_configuration(place, arguments, said):
    folder, directory = place
    assert said in refused("minimize", directory, *arguments.split(), "--store", folder / "store")


@each_row("name", ["nav2/dwb.yaml", "robots/turtlebot3_burger.yaml", "robots/turtlebot4.yaml"])
def test_candidates_try_parameters_of_file_one_by_one(failing, name):
    file = {FILE_KEY: nav2_file(CAMPAIGNS / name)}
    made, whole = failing(spelled_out(file), **{FILE_KEY: "own.yaml", "timeout": 20})
    with candidate_files(made) as files:
        built = files.built(whole)
        assert len(whole.kept) > 10 and FILE_KEY not in built.text
        assert parameters_of(built.configuration.scenario.system) == parameters_of(file)
        candidates = built.candidates(made)
        assert candidates.scenario(whole).digest == built.configuration.scenario.digest
        nothing = candidates.scenario(Candidate(frozenset()))
        assert nothing.system == {}
        assert nothing.digest == files.built(Candidate(frozenset())).configuration.scenario.digest


def test_candidate_with_file_fault_is_skipped(failing):
    made, whole = failing({"global_costmap.global_costmap.plugins": ["static_layer", "unheard_of"]})
    with candidate_files(made) as files, pytest.raises(NotBuilt, match="unheard_of"):
        files.built(whole)


def test_candidate_copies_filter_mask(failing, tmp_path):
    (tmp_path / "masks").mkdir()
    for file in ("rooms.yaml", yaml.safe_load((tmp_path / "rooms.yaml").read_text())["image"]):
        shutil.copyfile(tmp_path / file, tmp_path / "masks" / file)
    keepout = "{plugin: 'nav2_costmap_2d::KeepoutFilter'}"
    (tmp_path / "own.yaml").write_text(
        "global_costmap: {global_costmap: {ros__parameters: {plugins: [], filters: [own], own: " + keepout + "}}}"
    )
    mask = map_content(tmp_path / "masks" / "rooms.yaml")
    system = spelled_out({FILE_KEY: nav2_file(tmp_path / "own.yaml"), "keepout_mask": mask})
    made, whole = failing(system, **{FILE_KEY: "own.yaml", "timeout": 20})
    with candidate_files(made) as files:
        built = files.built(whole)
        assert "keepout_mask: keepout_mask/rooms.yaml" in built.text
        assert built.configuration.scenario.system["keepout_mask"].digest == mask.digest
        assert {"keepout_mask/rooms.yaml", "keepout_mask/rooms.pgm"} <= built.inputs.files.keys()
        without = Candidate(frozenset(each for each in whole.kept if each.key != "keepout_mask"))
        for build in (built.candidates(made).scenario, files.built):
            with pytest.raises(NotBuilt, match="The keepout filter of the global_costmap has no mask"):
                build(without)


PACER = "from vastflow.plugins import Mover\nclass Pacer(Mover):\n    def pose_at(self, t_s):\n        return 0.5, 0.5, 0.0\n"
BOX = "<geometry><box><size>1 1 1</size></box></geometry>"


def test_candidate_names_world_and_mover_of_own_file(failing):
    made, whole = failing({})
    inputs = made.directory / "inputs"
    (inputs / "worlds").mkdir(parents=True)
    (inputs / "pacer.py").write_text(PACER)
    (inputs / "worlds" / "post.sdf").write_text(
        f"<sdf version='1.6'><model name='c'><link name='l'><collision name='c'>{BOX}</collision></link></model></sdf>"
    )
    (inputs / "worlds" / "w.sdf").write_text(
        "<sdf><world name='w'><include><uri>post.sdf</uri></include></world></sdf>"
    )
    files = KeptFiles(made.directory, plug_ins=True)
    rule = files.plug_in(snapshot_of(inputs / "pacer.py", inputs).digest, "Pacer")
    movers = [{"name": "cart", "shape": {"radius_m": 0.2}, "rule": rule}]
    more = {"world": files.content(world_content(inputs / "worlds" / "w.sdf").digest), "movers": movers}
    subject = Subject(
        {**made.subject.values, **more}, {**made.subject.dimensions, **dict.fromkeys(more, "environment")}
    )
    assert _subject("own", Scenario("builtin:navigate_to_pose", 9.0, subject.values, {}, {})).values == subject.values
    made = replace(made, subject=subject)
    with candidate_files(made) as candidates:
        built = candidates.built(whole)
        assert "world: worlds/w.sdf" in built.text and "rule: pacer.py:Pacer" in built.text
        assert built.configuration.scenario.environment["world"].digest == more["world"].digest
        (body,) = movers_of(built.configuration.scenario.environment)
        assert body.rule.pose_at(1.0) == (0.5, 0.5, 0.0)


def test_spelled_out_keeps_keys_of_parameter_file_and_campaign_apart():
    forklift = {FILE_KEY: nav2_file(CAMPAIGNS / "robots" / "forklift.yaml")}
    assert spelled_out(forklift) == forklift  # it has what no key can say
    path = CAMPAIGNS / "robots" / "turtlebot4.yaml"
    system = {FILE_KEY: nav2_file(path), "batch_size": 500, "vx_max": 0.2}
    found, assumed = spelled_out(system), assumed_keys(system)
    assert parameters_of(found) == parameters_of(system)
    assert (found["batch_size"], found["vx_max"]) == (500, 0.2)
    assert not [key for key in found if key.endswith((".batch_size", ".vx_max"))]
    assert "collision_monitor.FootprintApproach.enabled" in assumed
    assert all(f"{key.rpartition('.')[2]}:" in path.read_text() for key in found.keys() - assumed)
    rpp = {FILE_KEY: nav2_file(CAMPAIGNS / "nav2" / "rpp.yaml")}
    assert (spelled_out(rpp)["controller"], "controller" in assumed_keys(rpp)) == ("rpp", False)


def test_placed_names_kept_paths_of_files_outside_of_campaign_folder():
    places = {"../nav2/rpp.yaml": "ab12/rpp.yaml", "../own.py": "cd34/own.py"}
    given = {"nav2_params": "../nav2/rpp.yaml", "oracles": [{"../own.py:Own": {"limit": 3}}, "safety", "here.py:Own"]}
    assert placed(given, places) == {
        "nav2_params": "ab12/rpp.yaml",
        "oracles": [{"cd34/own.py:Own": {"limit": 3}}, "safety", "here.py:Own"],
    }


def test_trials_try_first_candidate_alone_after_their_time(monkeypatch):
    monkeypatch.setattr(Trials, "_judged", lambda trials, candidate: Outcome("fails", 5, 5))
    trials = Trials(None, None, None, None, until_s=0.0)
    said = [trials.judge(Candidate(frozenset())) for _ in range(2)]
    assert [each.standing for each in said] == ["fails", "not tried"]
    assert said[1].reason == "the time was over"
