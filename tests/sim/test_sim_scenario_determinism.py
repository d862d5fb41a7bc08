"""Equal scenarios give equal recordings, behaviors included, wherever, whenever and beside whatever they are run."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from table import each_row

from vastflow.sim.model.rates import TICK_S
from vastflow.sim.replay import replay
from vastflow.sim.run import run
from vastflow.sim.scenario.tree.tree import ScenarioTree

CRATE = "spawn_entity('crate', pose_3d(position_3d(2.0m, 1.6m)), 'box', 'width:=0.3, mass:=2.0')"

MIXED = f"""
    var turns: int = 0
    do serial:
        robot.init_nav2(start)
        parallel:
            serial:
                failure_is_success()
                timeout(3s)
                robot.nav_to_pose(near)
            serial:
                wait elapsed(0.7s)
                spawn_multiple([{CRATE}])
            serial:
                wait random.get_int(0, 9) == 3
                log(random.get_float(0.0, 1.0))
            serial:
                repeat(2)
                wait elapsed(0.25s)
                increment(turns)
        one_of:
            robot.nav_to_pose(above)
            robot.odometry_distance_traveled(1.5m)
        delete_entity('crate')
        robot.nav_to_pose(above)
"""
"""Timers, draws, variables, a cancelled mission, one that gives way to a path driven, something spawned and deleted."""

TEXTS = {
    "mixed": MIXED,
    "goals in turn": "robot.nav_to_pose(near)\nrobot.nav_to_pose(above)",
    "goals in each other's way": """
        do serial:
            robot.init_nav2(start)
            parallel:
                serial:
                    failure_is_running()
                    robot.nav_to_pose(near)
                serial:
                    timeout(1.2s)
                    repeat(3)
                    serial:
                        wait elapsed(0.33s)
                        robot.nav_to_pose(above, success_on_acceptance: true)
    """,
    "events": """
        event half
        do serial:
            robot.init_nav2(start)
            parallel:
                serial:
                    robot.nav_to_pose(near)
                    emit half
                serial:
                    wait @half
                    wait elapsed(0.45s)
                    robot.nav_to_pose(start)
                robot.tf_close_to(0.1m, reference_point: position_3d(7.0m, 4.0m)) with:
                    until elapsed(5s)
    """,
    "in the world": """
        crate: osc_actor
        do serial:
            robot.init_nav2(start)
            parallel:
                actor_exists('crate')
                serial:
                    wait elapsed(1.05s)
                    crate.relative_spawn(distance: 0.5m, model: 'box', xacro_arguments: 'width:=0.3, mass:=1.0')
                serial:
                    timeout(6s)
                    robot.follow_waypoints([near, start])
    """,
}


def same(a, b):
    """Whether two recordings are the same but for places in the file."""
    rows = {name: column.tolist() for name, column in a.behaviors.items() if name not in ("line", "column")}
    others = {name: column.tolist() for name, column in b.behaviors.items() if name not in ("line", "column")}
    columns = all((a.columns[name] == b.columns[name]).all() for name in {**a.columns, **b.columns})
    return a.run == b.run and rows == others and columns


@pytest.fixture
def mixed(staged):
    return staged(MIXED)


@pytest.mark.parametrize("name", TEXTS)
def test_skipped_ticks_change_nothing(staged, monkeypatch, name):
    scenario = staged(TEXTS[name], timeout_s=30.0)
    made = []
    tick = ScenarioTree.tick
    monkeypatch.setattr(ScenarioTree, "tick", lambda self, number=None: (made.append(number), tick(self, number))[1])
    passed_over = [run(scenario, k) for k in range(3)]
    few = len(made)
    monkeypatch.setattr(ScenarioTree, "next_tick", lambda self: self.number + 1)
    every = [run(scenario, k) for k in range(3)]
    assert [recording.digest for recording in passed_over] == [recording.digest for recording in every]
    assert few <= len(made) - few


def test_runs_are_reproducible_and_distinct(mixed):
    digests = [run(mixed, k).digest for k in range(4)]
    assert len(set(digests)) == 4
    assert run(mixed, 2).digest == digests[2]
    assert run(mixed, 0, 1).digest != digests[0]


def test_run_digest_depends_on_scenario_content_and_lines(staged, mixed):
    first = run(mixed, 0)
    for text in (MIXED, MIXED.replace("do serial:", "do serial:  # in turn")):
        other = staged(text)
        assert other.abstract.path != mixed.abstract.path
        assert (other.digest, run(other, 0).digest) == (mixed.digest, first.digest)
    moved = staged(MIXED.replace("    var", "    # What is counted.\n    var"))
    assert moved.digest != mixed.digest
    again = run(moved, 0)
    assert same(again, first) and again.digest != first.digest
    changed = staged(MIXED.replace("wait elapsed(0.7s)", "wait elapsed(0.8s)"))
    assert changed.digest != mixed.digest
    assert run(changed, 0).run.seed == first.run.seed


def test_runs_in_threads_do_not_disturb_each_other(staged, mixed):
    asked = [(scenario, k) for k in range(3) for scenario in (mixed, staged(TEXTS["events"]))]
    alone = [run(scenario, k).digest for scenario, k in asked]
    with ThreadPoolExecutor(4) as pool:
        beside = [pool.submit(run, scenario, k) for scenario, k in asked]
        assert [each.result().digest for each in beside] == alone


def test_run_within_a_run_disturbs_neither(staged, mixed):
    inner = staged(TEXTS["in the world"])
    alone, inner_alone = run(mixed, 0).digest, run(inner, 1).digest
    within = []
    nested = run(mixed, 0, watch=lambda *_: within.append(run(inner, 1).digest), watch_ticks=[7, 60, 101])
    assert (nested.digest, within) == (alone, [inner_alone] * 3)


@each_row("name", TEXTS)
def test_replay_repeats_run_tick_by_tick(staged, name):
    scenario = staged(TEXTS[name], timeout_s=30.0)
    replayed, executed = replay(scenario, 1, 0, {}), run(scenario, 1)
    assert replayed.recording.digest == executed.digest
    ticks = round(executed.run.simulated_s / TICK_S)
    assert [moment.tick for moment in replayed.moments] == list(range(ticks))
