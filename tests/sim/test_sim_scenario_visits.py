"""Whole scenarios of a visit and of a tour, from their text to their verdict."""

import math
import textwrap
from pathlib import Path

import numpy as np
from py_trees.common import Status

from vastflow.sim.scenario.language.parameters import bound
from vastflow.sim.scenario.language.reading import read_text
from vastflow.sim.scenario.tree.action import Action
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.stand_ins import stand_ins
from vastflow.sim.scenario.tree.support import unsupported
from vastflow.sim.scenario.tree.tree import ScenarioTree


def ended(under_way, most=2000):
    while not under_way.ended and under_way.number < most:
        under_way.tick()
    return under_way


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


def with_drive(**outcome):
    """All actions of a visit, with a mission that ends so."""
    arrive = type("Arrive", (Drive,), {"end_s": 0.0})
    return {
        **HELPERS,
        **stand_ins({}),
        "spawn_multiple": arrive,
        "differential_drive_robot.init_nav2": arrive,
        "differential_drive_robot.nav_through_poses": type("Drive", (Drive,), outcome),
    }


def tree_of(text, actions, lines=None):
    (definition,) = read_text(textwrap.dedent(text), "visit.osc", Path())
    assert unsupported(definition, actions) == []
    functions = helper_functions(np.random.default_rng(0), "/config", "/out")
    log = (lambda line: None) if lines is None else lines.append
    return ScenarioTree(definition, bound(definition, {}), actions, functions, log=log)


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


def test_actions_of_a_ros_machine_do_not_stop_a_tour():
    tree = ended(tree_of(TOUR, with_drive(end_s=20.0)))
    assert (tree.passed, tree.now_s) == (True, 20.0)


def test_timeout_names_what_was_waited_for_not_what_only_goes_along():
    tree = ended(tree_of(TOUR, with_drive()))
    assert (tree.reason.cause, tree.now_s) == ("timeout", 60.2)
    assert tree.reason.message == "timeout(60 s) at visit.osc:10:5 ran out while nav_through_poses was running"


def test_visit_ends_with_its_mission_while_the_watchdog_runs_on():
    lines = []
    tree = ended(tree_of(VISIT, with_drive(end_s=33.3), lines))
    assert (tree.passed, tree.now_s, tree.reason.message, tree.reason.cause) == (True, 33.3, "", "")
    assert lines == ["alive"] * 30


def test_visit_whose_mission_fails_says_where_why_and_with_which_code():
    tree = ended(tree_of(VISIT, with_drive(end_s=7.0, status=Status.FAILURE)))
    assert (tree.passed, tree.now_s, tree.reason.cause, tree.reason.error_code) == (False, 7.0, "action", 308)
    assert tree.reason.message == "no path to the goal; nav_through_poses at visit.osc:20:13"


def test_visit_whose_mission_takes_too_long_names_the_timeout_that_ran_out():
    tree = ended(tree_of(VISIT, with_drive()))
    assert (tree.passed, tree.now_s, tree.reason.cause, tree.reason.error_code) == (False, 90.2, "timeout", 0)
    assert tree.reason.message == "timeout(90 s) at visit.osc:21:17 ran out while nav_through_poses was running"


def test_ticks_of_a_visit_that_matter_give_the_same_run():
    every, leaping = ended(tree_of(VISIT, with_drive())), tree_of(VISIT, with_drive())
    while not leaping.ended:
        leaping.tick(int(leaping.next_tick()))
    assert leaping.changes == every.changes
    assert leaping.reason.message == every.reason.message
