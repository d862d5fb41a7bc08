"""Scripts: what a scenario's runs are to do, as far as that is known before one."""

from pathlib import Path

import pytest
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.reading.abstract import abstract_content, definition_of
from vastflow.sim.reading.script import script_of

HERE, THERE = {"x": 1.0, "y": 2.0}, {"x": 3.0, "y": 4.0, "yaw": 1.0}
BOX = {"entity_name": "box", "model": "box", "spawn_pose": {"x": 2.0, "y": 2.0}}


def a_script(kind, environment=None, **task):
    return script_of(Scenario(f"builtin:{kind}", 60.0, environment or {}, {"start_pose": HERE, **task}, {}))


@each_row("kind", ["navigate_to_pose", "navigate_through_poses", "follow_waypoints"])
def test_missions_take_one_goal_and_those_through_poses_a_list(kind):
    script = a_script(kind, goal_pose=THERE)
    assert (script.start, script.goals, script.rounds) == (Pose(1, 2), (Pose(3, 4, 1),), 1)
    if kind != "navigate_to_pose":
        several = a_script(kind, goal_poses=[THERE, HERE])
        assert several.goals == (Pose(3, 4, 1), Pose(1, 2))
        assert several.passed == ((Pose(3, 4, 1),) if kind == "navigate_through_poses" else ())


def test_waypoints_are_repeated_as_often_as_asked():
    script = a_script("follow_waypoints", goal_poses=[THERE, HERE], number_of_loops=2)
    assert (len(script.goals), script.rounds) == (6, 3)


STEPS = {
    "robot.nav_through_poses([beyond, near, beyond])": 2,
    "robot.nav_through_poses([beyond, near, beyond]) with:\n            timeout(60s)": 2,
    "robot.nav_through_poses([beyond, near, beyond], success_on_acceptance: true)": 0,
    "robot.nav_through_poses([beyond, near, beyond]) with:\n            failure_is_success()": 0,
    "one_of:\n            robot.nav_through_poses([beyond, near])\n            wait elapsed(1s)": 0,
    "robot.follow_waypoints([beyond, near])": 0,
    "robot.nav_to_pose(beyond)\n        robot.nav_to_pose(near)": 0,
}


@each_row(("steps", "passed"), STEPS.items())
def test_goals_are_passed_where_every_run_that_succeeds_drives_through_them(steps, passed, tmp_path):
    file = tmp_path / "go.osc"
    file.write_text(
        "import osc.helpers\nimport osc.nav2\nimport osc.ros\n\nscenario go:\n    robot: differential_drive_robot\n"
        "    beyond: pose_3d = pose_3d(position_3d(3.0m, 4.0m))\n    near: pose_3d = pose_3d(position_3d(1.0m, 2.0m))\n"
        f"    do serial:\n        {steps}\n"
    )
    found = script_of(Scenario(abstract_content(file), 60.0, {}, {"start_pose": HERE}, {}))
    assert found.passed == (Pose(3.0, 4.0), Pose(1.0, 2.0))[:passed]


def test_obstacles_exist_unless_scenario_spawns_them():
    appears = {"spawn_trigger_point": HERE, "static_objects": [BOX], "boxes": [BOX]}
    script = a_script("obstacle_appears", appears, goal_pose=THERE)
    assert [obstacle.name for obstacle in script.obstacles] == ["box"]
    assert [entity["entity_name"] for entity in script.values["static_objects"]] == ["box"]
    assert [obstacle.name for obstacle in a_script("navigate_to_pose", {"boxes": [BOX]}, goal_pose=THERE).obstacles]


def test_robot_without_start_pose_starts_where_init_nav2_puts_it(tmp_path):
    file = tmp_path / "go.osc"
    file.write_text(
        "import osc.nav2\nimport osc.ros\n\nscenario go:\n    robot: differential_drive_robot\n    do serial:\n"
        "        robot.init_nav2(pose_3d(position_3d(5.0m, 1.0m)))\n"
    )
    assert script_of(Scenario(abstract_content(file), 60.0, {}, {}, {})).start == Pose(5.0, 1.0)


@each_row(
    ("kind", "task", "message"),
    [
        ("navigate_to_pose", {}, "parameter goal_pose of scenario navigate_to_pose: expected .*, got nothing"),
        ("follow_waypoints", {"goal_poses": "@x"}, "parameter goal_poses .*: expected a list of pose_3d, got '@x'"),
        (
            "navigate_through_poses",
            {"goal_poses": [THERE, 3]},
            r"parameter goal_poses.*: expected a mapping, .*, got 3",
        ),
        ("fly", {}, "expected one of builtin:navigate_to_pose, .*, got 'builtin:fly'"),
    ],
)
def test_meaningless_value_or_name_is_refused(kind, task, message):
    with pytest.raises(ValueError, match=message):
        a_script(kind, **task)


GO = "scenario go:\n    speed: int = 1\n    do serial:\n        wait elapsed(1s)\n"


def test_file_is_read_once_for_all_its_scenarios_and_fast(staged, loops):
    scenario = staged("robot.nav_to_pose(beyond)\nlog('there')")
    assert script_of(scenario).definition is script_of(scenario).definition is definition_of(scenario.abstract)
    assert loops(lambda: abstract_content(Path(scenario.abstract.path))) < 4
    assert loops(lambda: script_of(scenario), 10) < 0.2


def test_file_that_changed_since_it_was_read_is_refused(tmp_path):
    file = tmp_path / "go.osc"
    file.write_text("import osc.types\n" + GO)
    content = abstract_content(file)
    file.write_text("import osc.types\n" + GO.replace("1s", "3s"))
    with pytest.raises(ScenarioError, match=r"go\.osc changed since the campaign was read\. Run the campaign again"):
        definition_of(content)
