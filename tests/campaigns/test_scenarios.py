"""The shipped scenarios, each with the campaign beside it."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.summary import Work
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.page.report import write_report
from vastflow.oracles.query.scene import scenes_of
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.oracles.results.tables import read_tables
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.pose import pose_of
from vastflow.sim.reading.abstract import BUILTIN, SHIPPED, abstract_content, definition_digest, definition_of
from vastflow.sim.reading.vocabulary import ACTIONS
from vastflow.sim.run import run
from vastflow.sim.scenario.tree.support import unsupported

SCENARIOS = Path(__file__).parents[2] / "campaigns" / "scenarios"
WORK = Work(executed=1, reused=0, simulated_s=30.0, cpu_s=1.0, wall_s=1.0)


def campaign_of(name):
    return read_campaign(SCENARIOS / f"{name}.vast")


def configurations_of(name):
    return instantiate(campaign_of(name)[0]).configurations


def test_shipped_names_have_a_file_and_a_campaign():
    assert {file.stem for file in SCENARIOS.glob("*.osc")} == set(SHIPPED)
    assert {file.stem for file in SCENARIOS.glob("*.vast")} == set(SHIPPED)


@each_row("name", SHIPPED)
def test_shipped_scenario_names_resolve_to_runnable_files(name):
    definition = definition_of(BUILTIN + name)
    assert abstract_content(SCENARIOS / f"{name}.osc").digest == definition_digest(definition)
    assert unsupported(definition, ACTIONS) == []


@each_row("name", SHIPPED)
def test_latency_campaign_is_built_without_notes(name):
    campaign, _ = campaign_of(name)
    found = instantiate(campaign)
    assert (campaign.notes, campaign.unexecutable, found.rejections) == ((), (), ())
    assert 2 <= len(found.configurations) <= 4
    assert [c.name for c in found.configurations if c.duplicate_of] == []


@each_row("name", SHIPPED)
def test_first_run_of_its_campaign_passes(name):
    _, oracles = campaign_of(name)
    scenario = configurations_of(name)[0].scenario
    recorded = write_recordings([run(scenario, 0)])
    verdicts = judge_block(scenario, recorded, observe_block(scenario, recorded), oracles).verdicts
    assert [(verdict.oracle, verdict.reason) for verdict in verdicts if verdict.judgment != "pass"] == []


def test_rounds_after_the_first_take_longer():
    once, twice = (run(configuration.scenario, 0).run for configuration in configurations_of("follow_waypoints"))
    assert twice.distance_m > 1.5 * once.distance_m


@each_row("number", range(4))
def test_box_appears_within_configured_trigger_distance(number):
    scenario = configurations_of("obstacle_appears")[number].scenario
    recording = run(scenario, 0)
    (spawned,) = [event for event in recording.run.events if event.kind == "spawned"]
    place, threshold_m = (scenario.environment[f"spawn_trigger_{key}"] for key in ("point", "threshold"))
    assert (spawned.x_m, spawned.y_m) == pytest.approx((place["x"], place["y"]), abs=1e-3)
    row = int(recording.columns["t_ms"].searchsorted(round(spawned.t_s * 1000)))
    x_m, y_m = (recording.columns[f"estimated_{axis}_mm"][row] * 1e-3 for axis in "xy")
    away_m = math.hypot(x_m - place["x"], y_m - place["y"])
    assert away_m == pytest.approx(threshold_m, abs=0.15)  # a tick of 0.1 s at 0.5 m/s, and AMCL's next estimate


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The campaign directory of one run in which a box appears, and the configuration."""
    campaign, oracles = campaign_of("obstacle_appears")
    found = instantiate(campaign)
    configuration = found.configurations[0]
    scenario = configuration.scenario
    recorded = write_recordings([run(scenario, 0)])
    traces = observe_block(scenario, recorded)
    verdicts = judge_block(scenario, recorded, traces, oracles).verdicts
    written = write_results(
        campaign.path,
        tmp_path_factory.mktemp("results"),
        ConfigurationResult([recorded], [traces], verdicts),
        instantiation=replace(found, configurations=(configuration,)),
        runs=1,
        report=write_report,
    )
    assert written.faults == ()
    return written.directory, configuration


def test_report_shows_starts_goals_and_spawned_obstacles(results):
    directory, configuration = results
    (scene,) = scenes_of(read_tables(directory))
    (box,) = scene.obstacles
    assert (box.length_m, box.width_m) == (0.4, 0.4)
    goal = pose_of(configuration.scenario.task["goal_pose"])
    assert scene.goals_xy_m.tolist() == [[goal.x_m, goal.y_m]]
    assert (directory / "report.html").is_file()


def test_run_of_a_scenario_file_can_be_rebuilt_from_the_campaign_directory_alone(results):
    directory, configuration = results
    scenario = recorded_run(directory, configuration.name, 0).scenario
    assert scenario.digest == configuration.scenario.digest
    assert Path(scenario.abstract.path).is_relative_to(directory)
