"""Scenario files from their text to their verdict, in simulated time."""

import math
import textwrap
from pathlib import Path

import numpy as np
import pytest
from py_trees.common import Status
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.language.parameters import bound
from vastflow.sim.scenario.language.reading import read_text
from vastflow.sim.scenario.tree.action import Action
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.stand_ins import stand_ins
from vastflow.sim.scenario.tree.support import unsupported
from vastflow.sim.scenario.tree.tree import ScenarioTree


class Drive(Action):
    """The robot's mission: ends at a time that nobody knows beforehand."""

    end_s = math.inf
    status = Status.SUCCESS

    def __init__(self, situation):
        self.situation = situation

    def enter(self, arguments):
        self.arguments = arguments

    def update(self):
        if self.situation.clock.now_s < self.end_s:
            return Status.RUNNING
        self.message, self.error_code = ("no path to the goal", 308) if self.status is Status.FAILURE else ("", 0)
        return self.status

    def wakes_s(self):
        return math.inf


class Arrive(Drive):
    """Over at once."""

    end_s = 0.0


ACTIONS = {
    **HELPERS,
    **stand_ins({}),
    "spawn_multiple": Arrive,
    "differential_drive_robot.init_nav2": Arrive,
    "differential_drive_robot.nav_through_poses": Drive,
}


def tree_of(text, actions=ACTIONS, **values):
    (definition,) = read_text(textwrap.dedent(text), "visit.osc", Path())
    assert unsupported(definition, actions) == []
    functions = helper_functions(np.random.default_rng(0), "/config", "/out")
    return ScenarioTree(definition, bound(definition, values), actions, functions)


def ended(tree, most=2000):
    while not tree.ended and tree.number < most:
        tree.tick()
    return tree


BODIES = {
    # what is written below `scenario visit:`: whether it passes, and when it ends (s)
    "do serial:\n  wait elapsed(1s)": (True, 1.1),
    "timeout(2s)\ndo serial:\n  wait elapsed(5s)": (False, 2.2),
    "timeout(2s)\ndo serial:\n  wait elapsed(2s)": (True, 2.1),
    "do serial:\n  repeat(3)\n  wait elapsed(1s)": (True, 3.3),
    "do serial:\n  log('here')": (True, 0.1),
    "do log('here')": (True, 0.1),
    "d: time = 0.5s\ndo serial:\n  wait elapsed(d)": (True, 0.6),
    "do serial:\n  wait elapsed(1s)\n  wait elapsed(1s)\n  log('over')": (True, 2.1),
    "do parallel:\n  wait elapsed(1s)\n  wait elapsed(2s)": (True, 2.1),
    "do parallel:\n  wait elapsed(5s)\n  compare(1, '==', 2)": (False, 0.1),
    "do one_of:\n  wait elapsed(1s)\n  wait elapsed(2s)": (True, 1.1),
    "do one_of:\n  wait elapsed(1s)\n  compare(1, '==', 2)": (False, 0.1),
    "event go\ndo parallel:\n  wait @go\n  serial:\n    wait elapsed(1s)\n    emit go": (True, 1.2),
    "event go\ndo serial:\n  emit go\n  wait elapsed(1s)\n  wait @go": (True, 1.1),
    "var n: int = 0\ndo parallel:\n  wait n >= 3\n  serial:\n    repeat(3)\n    increment(n)": (True, 0.4),
    "event go\nvar n: int = 0\ndo parallel:\n  wait @go if n == 2\n  serial:\n    repeat(2)\n    emit go\n"
    "    wait elapsed(1s)\n    increment(n)": (True, 2.3),
    "do parallel:\n  wait elapsed(9s)\n  serial:\n    wait elapsed(1s)\n    emit end": (True, 1.1),
    "do parallel:\n  wait elapsed(9s)\n  serial:\n    wait elapsed(1s)\n    emit fail": (False, 1.1),
    "do parallel:\n  emit end\n  emit fail": (False, 0.1),
    "do serial:\n  log('a') with:\n    inverter()": (False, 0.1),
    "do serial:\n  log('a') with:\n    inverter()\n    inverter()": (True, 0.1),
    "do serial:\n  compare(1, '==', 2) with:\n    failure_is_success()": (True, 0.1),
    "do serial:\n  compare(1, '==', 2) with:\n    retry(3)": (False, 0.3),
    "do serial:\n  capture_screen() with:\n    timeout(1s)": (False, 1.2),
    "do serial:\n  capture_screen() with:\n    inverter()\n    timeout(1s)": (True, 1.2),
    "do serial:\n  capture_screen() with:\n    timeout(1s)\n    inverter()": (False, 1.2),
    "do serial:\n  capture_screen() with:\n    until elapsed(1s)": (True, 1.1),
    "do serial:\n  capture_screen() with:\n    until elapsed(1s)\n    timeout(0.5s)": (False, 0.7),
    "do serial:\n  capture_screen() with:\n    running_is_success()": (True, 0.1),
    "do serial:\n  serial:\n    wait elapsed(1s)\n  with:\n    timeout(0.5s)": (False, 0.7),
}


@each_row("body", BODIES)
def test_file_ends_as_its_words_say(body):
    text = "import osc.helpers\nimport osc.x11\nscenario visit:\n" + textwrap.indent(body, "  ")
    tree = ended(tree_of(text))
    assert (tree.passed, tree.now_s) == BODIES[body]


VISIT = """\
    import osc.helpers
    import osc.ros
    import osc.nav2
    import osc.gazebo

    scenario visit:
        timeout(120s)
        start: pose_3d = pose_3d()
        goals: list of pose_3d = [pose_3d()]
        boxes: list of spawn_entity = [spawn_entity('crate', model: 'box')]
        bot: differential_drive_robot
        do parallel:
            serial:
                repeat()
                wait elapsed(1s)
                log("alive")
            serial:
                spawn_multiple(boxes)
                bot.init_nav2(start)
                bot.nav_through_poses(goals) with:
                    timeout(90s)
                emit end
    """


TOUR = """\
    import osc.helpers
    import osc.ros
    import osc.nav2
    import osc.gazebo
    import osc.floorplan_dsl
    import osc.os
    import osc.x11

    scenario tour:
        timeout(60s)
        mesh_file: string = "hall.stl"
        start: pose_3d = pose_3d()
        goals: list of pose_3d = [pose_3d(position_3d(x: 2.0m)), pose_3d(position_3d(x: 4.0m))]
        bot: differential_drive_robot
        plan: floorplan_generator
        do parallel:
            capture_screen()
            serial:
                plan.generate_gazebo_world(sdf_template: "hall.sdf", arguments: [key_value("mesh", mesh_file)])
                parallel:
                    ros_launch("bringup", "sim.py", arguments: [
                        key_value("world", plan.generated_gazebo_world_path),  # empty: there is no such file
                        key_value("x", "at " + mesh_file)])
                    serial:
                        repeat()
                        wait elapsed(2s)
                        check_process_running("gz")
                    serial:
                        wait_for_sim()
                        bot.init_nav2(start)
                        parallel:
                            bag_record(["/scan"])
                            serial:
                                bot.nav_through_poses(goals)
                                emit end
    """


def test_what_only_the_ros_machine_needs_stands_in_the_way_of_nothing():
    tree = ended(tree_of(TOUR, with_drive(end_s=20.0)))
    assert (tree.passed, tree.now_s) == (True, 20.0)


def test_timeout_names_what_was_waited_for_not_what_only_goes_along():
    tree = ended(tree_of(TOUR))
    assert (tree.cause, tree.now_s) == ("timeout", 60.2)
    assert tree.message == "timeout(60 s) at visit.osc:10:5 ran out while nav_through_poses was running"


def with_drive(**outcome):
    return {**ACTIONS, "differential_drive_robot.nav_through_poses": type("Drive", (Drive,), outcome)}


def test_visit_ends_with_its_mission_while_the_watchdog_runs_on():
    lines = []
    (definition,) = read_text(textwrap.dedent(VISIT), "visit.osc", Path())
    tree = ended(ScenarioTree(definition, bound(definition, {}), with_drive(end_s=33.3), {}, log=lines.append))
    assert (tree.passed, tree.now_s, tree.message, tree.cause) == (True, 33.3, "", "")
    assert lines == ["alive"] * 30


def test_visit_whose_mission_fails_says_where_why_and_with_which_code():
    tree = ended(tree_of(VISIT, with_drive(end_s=7.0, status=Status.FAILURE)))
    assert (tree.passed, tree.now_s, tree.cause, tree.error_code) == (False, 7.0, "action", 308)
    assert tree.message == "no path to the goal; nav_through_poses at visit.osc:20:13"


def test_visit_whose_mission_takes_too_long_names_the_timeout_that_ran_out():
    tree = ended(tree_of(VISIT))
    assert (tree.passed, tree.now_s, tree.cause, tree.error_code) == (False, 90.2, "timeout", 0)
    assert tree.message == "timeout(90 s) at visit.osc:21:17 ran out while nav_through_poses was running"


def test_ticks_of_a_visit_that_matter_give_the_same_run():
    every, leaping = ended(tree_of(VISIT)), tree_of(VISIT)
    while not leaping.ended:
        leaping.tick(int(leaping.next_tick()))
    assert leaping.changes == every.changes
    assert leaping.message == every.message


def test_division_by_zero_in_a_file_says_where():
    text = """\
        import osc.helpers
        scenario visit:
            var n: int = 0
            do serial:
                wait elapsed(0.5s)
                wait 1 / n > 2
        """
    tree = tree_of(text)
    with pytest.raises(ScenarioError, match=r"visit\.osc:6:.*zero"):
        ended(tree)
    assert tree.now_s == 0.6


def test_function_of_the_file_that_refuses_its_arguments_says_why():
    text = """\
        import osc.helpers
        scenario visit:
            do serial:
                log(random.get_int(6, 1))
        """
    with pytest.raises(ScenarioError, match="the lower bound comes first"):
        ended(tree_of(text))
