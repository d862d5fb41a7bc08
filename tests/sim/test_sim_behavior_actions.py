"""Actions that need neither simulator nor process, stand-ins for the ROS machine's, and what can't be had."""

import math
import subprocess
import sys

import numpy as np
import pytest
from py_trees.common import Status
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.reading.vocabulary import ACTIONS, WORLDLY
from vastflow.sim.scenario.programs.actions import PROCESSES
from vastflow.sim.scenario.tree.action import ActionSituation
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.stand_ins import SIMULATOR_PROCESSES, stand_ins
from vastflow.sim.scenario.tree.topics import ROS
from vastflow.sim.scenario.tree.world import WORLD


@pytest.fixture
def lines():
    return []


@pytest.fixture
def made(lines):
    """Makes an action by name and enters it; answers status and message."""

    def make(action, variables=None, known=HELPERS, **arguments):
        situation = ActionSituation({}, "", None, {} if variables is None else variables, lines.append)
        acting = known[action](situation)
        acting.enter(arguments)
        status = acting.update()
        return status, acting.message

    return make


def functions(seed=1):
    return helper_functions(np.random.default_rng(seed), "/scenarios", "/results/run")


def test_compare_succeeds_where_the_relation_holds(made):
    for left, sign, right in ((1, "==", 1), (1, "!=", 2), (1.5, "<", 2), (2, "<=", 2), ("b", ">", "a"), (2, ">=", 2)):
        compared = f"{left!r} {sign} {right!r}"
        assert made("compare", left_value=left, operator=sign, right_value=right)[1] == f"{compared} holds"
    assert made("compare", left_value=1, operator=">", right_value=2) == (Status.FAILURE, "1 > 2 does not hold")


@each_row(
    ("action", "arguments", "message"),
    [
        ("compare", {"left_value": 1, "operator": "=>", "right_value": 2}, "expected one of ==, !=, <, .*, got '=>'"),
        ("compare", {"left_value": 1, "operator": "<", "right_value": "a"}, "1 and 'a' can't be compared by <"),
        ("increment", {"target_variable": "ready"}, "ready: expected a number to count, got True"),
        ("increment", {"target_variable": "cuont"}, r"'cuont' is not a variable with a value\. Did you mean 'count'\?"),
        ("random.get_int", (6, 1), "the lower bound comes first, got 6 and 1"),
        ("random.get_float", (1.0, 0.5), "the lower bound comes first"),
        ("random.get_random_string", ([],), "at least one item"),
    ],
)
def test_argument_without_meaning_is_refused(made, action, arguments, message):
    with pytest.raises(ValueError, match=message):
        if isinstance(arguments, tuple):
            functions()[action](*arguments)
        else:
            made(action, {"ready": True, "count": 1}, **arguments)


def test_increment_and_decrement_change_a_variable(made):
    variables = {"count": 3, "share": 0.5}
    assert made("increment", variables, target_variable="count") == (Status.SUCCESS, "count is 4")
    assert made("decrement", variables, target_variable="share")[0] is Status.SUCCESS
    assert variables == {"count": 4, "share": -0.5}


def test_random_numbers_come_only_from_run_generator():
    def drawn(seed):
        known = functions(seed)
        asked = (("get_int", (1, 6)), ("get_float", (2.0, 3.0)), ("get_random_string", (["a", "b", "c"],)))
        return [[known[f"random.{name}"](*arguments) for _ in range(50)] for name, arguments in asked]

    assert drawn(7) == drawn(7) != drawn(8)
    whole, numbers, texts = drawn(7)
    assert (set(whole), set(texts)) == ({1, 2, 3, 4, 5, 6}, {"a", "b", "c"})
    assert all(2.0 <= x < 3.0 for x in numbers)


def test_file_seed_makes_runs_draw_equally():
    one, other = functions(1), functions(2)
    assert one["random.seed"](5) == other["random.seed"](5) == 5
    assert one["random.get_float"](0.0, 1.0) == other["random.get_float"](0.0, 1.0)


def test_folders_and_paths_are_those_of_the_run():
    known = functions()
    assert known["common.get_scenario_file_directory"]() == "/scenarios"
    assert known["common.get_output_directory"]() == "/results/run"
    assert known["os.abspath"]("../maps/hall.yaml") == "/maps/hall.yaml"
    assert known["os.basename"]("/maps/hall.yaml") == "hall.yaml"
    assert known["os.dirname"]("/maps/hall.yaml") == "/maps"


def test_stand_ins_log_their_replacement(made, lines):
    launch = {"package_name": "nav2_bringup", "launch_file": "bringup.py"}
    for action, status, arguments in (
        ("ros_launch", Status.RUNNING, launch),
        ("ros_launch", Status.SUCCESS, {**launch, "wait_for_shutdown": False}),
        ("capture_screen", Status.RUNNING, {}),
        ("bag_record", Status.SUCCESS, {"topics": ["/tf"]}),
        ("wait_for_sim", Status.SUCCESS, {}),
        ("floorplan_generator.generate_gazebo_world", Status.SUCCESS, {}),
    ):
        assert made(action, known=stand_ins({}), **arguments)[0] is status
    assert len(lines) == 6
    assert lines[0].startswith("ros_launch nav2_bringup bringup.py: ")


def test_stand_ins_wake_no_tree_and_ask_others_for_programs(made):
    for action in ("ros_launch", "capture_screen"):
        assert stand_ins({})[action](ActionSituation({}, "", None, {}, [].append)).wakes_s() == math.inf
    known = stand_ins({"check_process_running": HELPERS["log"]})
    assert made("check_process_running", known=known, process_name="growth", msg="asked")[0] is Status.SUCCESS


def test_simulators_programs_run_as_long_as_it_does(made):
    known = stand_ins({})

    def asked(process, regex=False):
        return made("check_process_running", known=known, process_name=process, regex=regex)

    for process, regex in (*((name, False) for name in SIMULATOR_PROCESSES), ("nav2_amcl", False), ("^gz", True)):
        assert asked(process, regex)[0] is Status.SUCCESS
    assert asked("rviz2") == (Status.FAILURE, "no process rviz2 is running")
    with pytest.raises(ScenarioError, match=r"'\(' is no regular expression"):
        asked("(", regex=True)


def test_implemented_actions_are_the_known_ones():
    assert {*WORLD, *ROS} - stand_ins({}).keys() == WORLDLY
    assert {*HELPERS, *WORLD, *ROS, *PROCESSES, *stand_ins({})} == ACTIONS


def test_names_are_known_without_the_simulator():
    script = "import sys, vastflow.sim.reading.vocabulary; print(*{'numba', 'pymunk', 'scipy'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=240, check=True)
    assert done.stdout.split() == []
