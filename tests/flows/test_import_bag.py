"""Imported bags: recorded runs in an ordinary campaign, and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import called, refused
from real_bags import Recorder, drawn_map, driven

from vastflow.flows.bags.drive import Drive
from vastflow.flows.bags.imported import place_of, spread_of, write_import
from vastflow.flows.bags.recorded import wall_contacts
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.configurations import distinct_configurations
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.query.frames import frames_of, stored_run
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.blocks import read_block, read_recordings, write_recordings
from vastflow.sim.model.faults import FileError, ScenarioError
from vastflow.sim.model.pose import Pose
from vastflow.sim.run import execute
from vastflow.sim.system.system import system_of
from vastflow.sim.world.occupancy import OccupancyMap

pytestmark = pytest.mark.timeout(600)
PLAIN = Recorder(scans=False, odometry_hz=25.0)
TRUE = replace(PLAIN, truth="base_link_true")
COSTMAPS = ("local_costmap", "global_costmap")
ORACLES = [("safety", {"fail_on_contact": "any"}), ("robustness", {}), ("navigation", {})]


@pytest.fixture(scope="module")
def drive():
    return driven(lengths_m=(3.0,))


def written(tmp_path, drive, recorder=PLAIN, runs=2, params=None):
    path = recorder.write(tmp_path / "lab", drive)
    (tmp_path / "campaign").mkdir()
    file, (imported,) = write_import(tmp_path / "campaign", [path], drawn_map(tmp_path / "map"), params, runs=runs)
    return file, imported


def scenarios(file):
    """Name to configuration with its number of runs, without Prefect."""
    campaign, _ = read_campaign(file)
    return {each.name: each for each in distinct_configurations(instantiate(campaign), campaign.runs)}


def judged(tmp_path, drive, recorder):
    file, _ = written(tmp_path, drive, recorder)
    real = scenarios(file)["real"].scenario
    recordings = write_recordings([execute(real, 0, 3).recording])
    traces = observe_block(real, recordings)
    return judge_block(real, recordings, traces, oracles_of(ORACLES)).verdicts, read_block(traces)[0][1]


def test_import_writes_a_campaign_of_one_recorded_and_several_simulated_runs(tmp_path, drive):
    file, _ = written(tmp_path, drive)
    found = scenarios(file)
    assert {name: each.runs for name, each in found.items()} == {"real": 1, "simulated": 2}
    real, simulated = found["real"].scenario, found["simulated"].scenario
    assert real.situation_digest == simulated.situation_digest and real.digest != simulated.digest


def test_import_simulates_the_robot_of_the_parameters(tmp_path, drive):
    params = tmp_path / "wide.yaml"
    costmaps = [f"{name}: {{{name}: {{ros__parameters: {{robot_radius: 1.5}}}}}}\n" for name in COSTMAPS]
    params.write_text("".join(costmaps))
    file, _ = written(tmp_path, drive, TRUE, params=params)
    found = scenarios(file)
    assert {system_of(each.scenario.system).inscribed_radius_m for each in found.values()} == {1.5}
    (kept,) = read_recordings(file.parent / "recordings" / "lab.parquet")
    assert {event.what for event in kept.run.events if event.kind == "contact"} == {"wall"}  # the robot stays 1.2 m off


def test_recorded_run_is_read_and_not_simulated(tmp_path, drive):
    file, _ = written(tmp_path, drive)
    real = scenarios(file)["real"].scenario
    recording = execute(real, 0, 3).recording
    (kept,) = read_recordings(file.parent / "recordings" / "lab.parquet")
    assert all((recording.columns[name] == kept.columns[name]).all() for name in kept.columns)
    assert recording.run == replace(kept.run, seed=recording.run.seed)
    assert recording.run.seed.startswith("3:")
    with pytest.raises(ScenarioError, match=r"expected run 0, the only one that lab\.parquet has, got run 1"):
        execute(real, 1, 3)
    with pytest.raises(ScenarioError, match="expected a simulated run, got a recorded one"):
        execute(real, 0, 3, watch=lambda *_: None)


def test_recorded_run_is_refused_when_its_file_changed(tmp_path, drive):
    file, _ = written(tmp_path, drive)
    real = scenarios(file)["real"].scenario
    kept = file.parent / "recordings" / "lab.parquet"
    kept.write_bytes(kept.read_bytes() + b" ")
    with pytest.raises(ScenarioError, match="expected the recording that the campaign was read with, got another"):
        execute(real, 0, 3)


def test_campaign_file_names_a_recording_that_exists(tmp_path, drive):
    file, _ = written(tmp_path, drive)
    file.write_text(file.read_text().replace("recordings/lab.parquet", "none.parquet"))
    with pytest.raises(FileError, match=r"expected a recording of `vastflow import` \(.*none\.parquet"):
        read_campaign(file)


def test_verdicts_on_an_estimated_pose_say_so_and_judge_no_contact(tmp_path, drive):
    verdicts, derived = judged(tmp_path, drive, PLAIN)
    origin = "the pose is the robot's estimate: map → odom → base_link"
    said = {each.oracle: (each.judgment, each.reason) for each in verdicts}
    assert said == {
        "success": ("pass", origin),
        "safety": ("not judged", f"contacts: expected the true pose, got the robot's estimate alone; {origin}"),
        "robustness": ("not judged", f"the trace has no localization_error_m; {origin}"),
        "navigation": ("pass", origin),
    }
    assert derived.keys() == {"stopped", "deviation_mm"}
    (clearance,) = (each.metrics["minimum_clearance"] for each in verdicts if each.oracle == "navigation")
    assert clearance.value is None


def test_verdicts_on_a_true_pose_are_those_of_any_run(tmp_path, drive):
    verdicts, derived = judged(tmp_path, drive, TRUE)
    assert {each.oracle: (each.judgment, each.reason) for each in verdicts} == {
        **dict.fromkeys(("success", "safety", "robustness", "navigation"), ("pass", "")),
    }
    assert derived["wall_clearance_mm"].min() == pytest.approx(1200, abs=2)
    assert np.median(derived["localization_error_mm"]) == pytest.approx(50, abs=3)


def test_place_of_a_value_is_its_rank_among_simulated_ones():
    simulated = [float(k) for k in range(1, 20)]
    assert place_of("s", 10.0, simulated).p == 1.0
    outside = place_of("s", 25.0, simulated)
    assert (outside.outside, outside.p) == (True, 0.1)  # 2 / (19 + 1)
    assert place_of("s", 19.0, simulated).p == pytest.approx(2 * 2 / 20)
    assert place_of("s", None, simulated).p is None and place_of("s", None, simulated).outside is None
    assert place_of("s", 1.0, []).p is None
    assert place_of("s", 25.0, simulated[:-1]).outside is None  # 2 / (18 + 1) is more than 10 %


def test_place_of_a_run_like_the_simulated_has_uniform_p_values():
    rng = np.random.default_rng(0)
    drawn = rng.normal(size=(4000, 21)).tolist()
    values = [place_of("s", real, simulated).p for real, *simulated in drawn]
    for level in (0.1, 0.2, 0.5):
        assert np.mean(np.array(values) <= level) <= level + 0.02


def signals_of(values):
    return {f"s{k}": value for k, value in enumerate(values)}


def test_spread_holds_its_level_for_one_more_run():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(1500):
        common = rng.normal(size=(21, 1)) + 0.3 * rng.normal(size=(21, 12))  # signals that depend on one another
        counts = rng.poisson(0.3, size=(21, 3)).astype(float)  # with many ties
        found.append(spread_of([signals_of([*row, 1.0]) for row in np.hstack([common, counts]).tolist()]).p)
    for level in (0.05, 0.1, 0.2, 0.5):
        assert np.mean(np.array(found) <= level) <= level + 0.02


def test_spread_tells_many_odd_signals_from_one():
    rng = np.random.default_rng(3)
    simulated = rng.normal(size=(20, 12)).tolist()
    other = spread_of([signals_of(row) for row in ([5.0] * 12, *simulated)])
    assert (other.beyond[0], other.p) == (12, pytest.approx(1 / 21))
    once = spread_of([signals_of(row) for row in ([5.0, *[0.0] * 11], *simulated)])
    assert once.beyond[0] == 1 and once.places[0].outside and once.p > 0.3
    assert spread_of([signals_of([1.0]), signals_of([2.0])]).p is None
    failed = spread_of([signals_of([1.0, None]), *map(signals_of, simulated)])
    assert failed.places[1].p is None and len(failed.beyond) == 21


def test_wall_contact_begins_a_cell_within_the_radius_of_the_true_pose():
    cells = np.zeros((40, 40), dtype=np.int8)
    cells[:, 39] = 100  # its centers are at 1.975 m
    ground, t_s = OccupancyMap(cells, 0.05, (0.0, 0.0)), 0.1 * np.arange(6)
    for near_m, begins_s in (
        (1.825, []),
        (1.875, [0.1, 0.3]),
    ):  # centers of cells, 0.15 m and 0.1 m from those of the wall
        true = np.column_stack(([1.0, near_m, 1.0, near_m, near_m, 1.0], np.full(6, 1.0), np.zeros(6)))
        told = Drive(t_s, true, true, "", Pose(1.0, 1.0), "", "succeeded", "", ())
        assert [(each.t_s, each.what) for each in wall_contacts(told, ground, 0.19)] == [(t, "wall") for t in begins_s]


def test_import_refuses_unusable_bags_and_options(tmp_path, drive):
    room = drawn_map(tmp_path / "map")
    path = PLAIN.write(tmp_path / "lab", drive)
    assert refused("import", path, "--map", tmp_path / "no.yaml").startswith("--map: expected a file, got ")
    assert refused("import", tmp_path / "none", "--map", room).endswith("expected a bag, got no such file or folder")
    said = refused("import", path, "--map", room, "--start", "1,2")
    assert said == "--start: expected X,Y,YAW in m and rad, got '1,2'"
    said = refused("import", path, "--map", room, "--namespace", "robot7", "--results", tmp_path / "results")
    assert said.endswith("lab: can't be read: --namespace: expected the beginning of a topic, got 'robot7'")


def test_import_without_rosbags_names_the_extra(tmp_path, drive, monkeypatch):
    path = PLAIN.write(tmp_path / "lab", drive)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    said = refused("import", path, "--map", drawn_map(tmp_path / "map"), "--results", tmp_path / "results")
    assert said == "rosbags is missing. Call pip install 'vastflow[ros]'."


@pytest.mark.slow
def test_import_command_sets_a_real_run_beside_simulated_ones(tmp_path, drive, one_server):
    bags = [recorder.write(tmp_path / name, drive) for name, recorder in (("lab", PLAIN), ("hall", TRUE))]
    room, store = drawn_map(tmp_path / "map"), tmp_path / "store"
    options = ("--map", room, "--runs", 3, "--workers", 1, "--store", store, "--results", tmp_path / "results")
    with one_server(tmp_path / "prefect"):
        told = called("import", *bags, *options)
        assert told.exit_code == 0, told.output
        again = json.loads(called("import", *bags, *options, "--json").stdout)
        (first, *_) = sorted((tmp_path / "results").iterdir())
        rerun = called("run", first, "--store", store)
        assert rerun.exit_code == 0 and "0 runs executed, 8 from the store" in rerun.stdout, rerun.output
    assert "pose: the robot's estimate (map → odom → base_link); no clearance, no contacts" in told.stdout
    assert "bag2-real: succeeded" in told.stdout and "pose: the true pose" in told.stdout
    few = "with 3 runs no p-value is below 0.5: too few to call a signal outside, which takes --runs 19"
    assert few in told.stdout and "OUTSIDE" not in told.stdout
    places = {each["signal"]: each for each in again["spreads"]["bag2-real"]["places"]}
    assert places["navigation: minimum_clearance (m)"]["real"] == pytest.approx(1.2, abs=0.01)
    estimated = {each["signal"]: each["real"] for each in again["spreads"]["bag1-real"]["places"]}
    assert estimated["navigation: minimum_clearance (m)"] is None
    assert "bag1-simulated" in called("show", first).stdout
    run = stored_run(first, "bag1-real", 0)
    facts, frames = frames_of(run, "bag1-real")
    assert facts and len(next(iter(frames.values())))
    assert "real" in (first / "report.html").read_text()
    compared = called("compare", first, again["results"])
    assert compared.exit_code == 0, compared.output
    replayed = refused("replay", first, "bag1-real", 0)
    assert "expected a simulated run, got a recorded one, which can't be executed once more" in replayed
