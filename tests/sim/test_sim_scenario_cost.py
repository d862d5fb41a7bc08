"""Costs of a scenario file beside the simulation: reading, trees, and ticks."""

from pathlib import Path

from vastflow.sim.reading.abstract import abstract_content, definition_of
from vastflow.sim.reading.script import script_of
from vastflow.sim.run import run
from vastflow.sim.scenario.tree.tree import ScenarioTree

TEXT = """
    do serial:
        robot.init_nav2(start)
        parallel:
            robot.nav_to_pose(beyond)
            serial:
                robot.tf_close_to(0.5m, reference_point: position_3d(3.0m, 2.0m))
                wait elapsed(1s)
                log('there')
"""


def test_file_is_read_once_for_all_its_scenarios(staged):
    scenario = staged(TEXT)
    first = definition_of(scenario.abstract)
    for _ in range(3):
        assert script_of(scenario).definition is first


def test_reading_a_file_and_making_its_script_are_small_beside_a_run(staged, loops):
    scenario = staged(TEXT)
    assert loops(lambda: abstract_content(Path(scenario.abstract.path))) < 4
    assert loops(lambda: script_of(scenario), 10) < 0.2


def test_ticks_are_made_where_something_is_looked_at(staged, monkeypatch):
    made = []
    tick = ScenarioTree.tick
    monkeypatch.setattr(ScenarioTree, "tick", lambda self, number=None: (made.append(number), tick(self, number))[1])
    recording = run(staged(TEXT), 0)
    b = recording.behaviors
    close_s = float(b["t_s"][(b["name"] == "tf_close_to") & (b["status"] == "SUCCESS")][0])
    looked_at = round(close_s / 0.1)
    assert recording.run.simulated_s / 0.1 > looked_at + 30
    assert looked_at <= len(made) <= looked_at + 8
