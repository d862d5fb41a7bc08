"""Scenario files in the shapes in which people write them for scenario-execution: each drives when it is executed."""

import textwrap
from pathlib import Path

import pytest

from vastflow.sim.model.scenario import scenario_of
from vastflow.sim.reading.abstract import abstract_content, hall_file
from vastflow.sim.reading.vocabulary import ACTIONS
from vastflow.sim.run import execute
from vastflow.sim.scenario.language.reading import read_scenarios
from vastflow.sim.scenario.tree.support import unsupported
from vastflow.sim.world.map_file import map_content

UPSTREAM = Path(__file__).parents[3] / "shared" / "upstream" / "robovast-configs"

IMPORTS = "".join(
    f"import osc.{name}\n" for name in ("helpers", "ros", "nav2", "gazebo", "os", "x11", "floorplan_dsl", "sim")
)

SHAPES = {
    "a recorder and a watchdog beside the mission": """
        scenario test_scenario:
            timeout(360s)
            mesh_file: string
            map_file: string
            start_pose: pose_3d
            goal_pose: pose_3d
            noise: string = '0.0'
            static_objects: list of spawn_entity
            plan: floorplan_generator
            robot: differential_drive_robot
            do parallel:
                capture_screen(frame_rate: 2.0, output_filename: 'run.webm')
                wait elapsed(1000s)
                serial:
                    plan.generate_gazebo_world('world.sdf.xacro', [key_value('mesh', os.abspath(common.get_scenario_file_directory() + '/' + mesh_file))])
                    ros_launch('', 'nav2_launch.py', [
                        key_value('world', plan.generated_gazebo_world_path),
                        key_value('x_pose', start_pose.position.x),
                        key_value('noise', noise)],
                        wait_for_shutdown: false)
                    wait_for_sim()
                    parallel:
                        serial:
                            repeat()
                            wait elapsed(1s)
                            check_process_running('gz')
                        serial:
                            spawn_multiple(static_objects)
                            robot.init_nav2(start_pose)
                            bag_record(['/tf', '/tf_static', '/scenario_execution/snapshots', '/amcl_pose'],
                                # hidden_topics: true,
                                use_sim_time: true, timestamp_suffix: false)
                            robot.nav_to_pose(goal_pose)
                            emit end
    """,
    "a launch that runs on beside the mission": """
        scenario test_scenario:
            robot: differential_drive_robot
            goal_pose: pose_3d
            do parallel:
                ros_launch('nav2_bringup', 'tb4_simulation_launch.py', [key_value('headless', 'False')])
                capture_screen('capture.webm', frame_rate: 2.0)
                serial:
                    robot.init_nav2(pose_3d(position_3d(x: 1.0m, y: 1.0m)), wait_for_amcl: false)
                    bag_record(['/tf', '/odom'], use_sim_time: true)
                    robot.nav_to_pose(goal_pose)
                    emit end
    """,
    "a time-out in a branch of its own": """
        scenario nav2_simulation_nav_to_pose:
            goal_pose: pose_3d
            robot: differential_drive_robot
            do parallel:
                test_drive: serial:
                    robot.init_nav2(initial_pose: pose_3d(position: position_3d(x: 1.0m, y: 1.0m)))
                    robot.nav_to_pose() with:
                        keep(it.goal_pose == goal_pose)
                    emit end
                time_out: serial:
                    wait elapsed(240s)
                    emit fail
    """,
    "arguments by keep, and plain numbers": """
        scenario relative:
            timeout(120)
            robot: differential_drive_robot
            box: osc_actor
            do parallel:
                serial:
                    robot.init_nav2(pose_3d(position_3d(x: 1.0, y: 1.0)))
                    robot.nav_to_pose(goal_pose: pose_3d(position: position_3d(x: 3.2, y: 1.0)))
                    emit end
                serial:
                    robot.tf_close_to() with:
                        keep(it.reference_point.x == 1.5m)
                        keep(it.reference_point.y == 1.0m)
                        keep(it.threshold == 0.35m)
                        keep(it.robot_frame_id == 'turtlebot4_base_link_gt')
                    box.spawn(
                        spawn_pose: pose_3d(position: position_3d(x: 3.0m, y: 4.0m, z: 0.1m)),
                        model: 'example_simulation://models/box.sdf',
                        world_name: 'maze')
                    wait elapsed(1000s)
    """,
    "an action of one's own, and a goal on a topic": """
        action differential_drive_robot.dock inherits differential_drive_robot.nav_to_pose:
            goal_pose: pose_3d = pose_3d(position_3d(x: 1.5m, y: 1.0m))
        scenario published:
            robot: differential_drive_robot
            do serial:
                robot.init_nav2(pose_3d(position_3d(x: 1.0m, y: 1.0m)))
                wait_for_topics(['/scan', '/amcl_pose'])
                topic_publish(topic_name: '/goal_pose', topic_type: 'geometry_msgs.msg.PoseStamped',
                    value: '{\\"pose\\": {\\"position\\": {\\"x\\": 3.0, \\"y\\": 1.0}, \\"orientation\\": {\\"w\\": 1.0}}}')
                log_check('bt_navigator', ['Goal succeeded'])
                robot.dock()
    """,
    "a condition that has to hold for a while": """
        scenario held:
            var x: float = 0.0
            robot: differential_drive_robot
            do serial:
                robot.init_nav2(pose_3d(position_3d(x: 1.0m, y: 1.0m)))
                topic_monitor('/odom', 'nav_msgs.msg.Odometry', x, member_name: 'pose.pose.position.x')
                parallel:
                    robot.nav_to_pose(pose_3d(position_3d(x: 3.2m, y: 1.0m)))
                    serial:
                        serial:
                            wait x > 0.5
                            one_of:
                                wait elapsed(1s)
                                serial:
                                    wait x < 0.5
                                with:
                                    success_is_failure()
                        with:
                            retry()
                        log('beyond half a meter for a second')
                    with:
                        timeout(60s)
    """,
}  # fmt: skip

GIVEN = {
    "start_pose": {"x": 1.0, "y": 1.0},
    "goal_pose": {"x": 3.0, "y": 1.0},
    "mesh_file": "hall.stl",
    "static_objects": [],
}


def driven(file, two_rooms, **given):
    """The run of a scenario file in the two rooms."""
    (definition,) = read_scenarios(file)
    assert unsupported(definition, ACTIONS) == []
    known = {parameter.name for parameter in definition.parameters}
    values = {key: value for key, value in {**GIVEN, **given}.items() if key in {"start_pose", *known}}
    tags = {"static_objects": "environment"}
    scenario = scenario_of({**values, "map_file": two_rooms}, tags, abstract=abstract_content(file), timeout_s=400.0)
    return execute(scenario, 0).recording.run


@pytest.mark.parametrize("shape", SHAPES)
def test_scenario_of_this_shape_drives(tmp_path, two_rooms, shape):
    file = tmp_path / "trial.osc"
    file.write_text(IMPORTS + textwrap.dedent(SHAPES[shape]))
    found = driven(file, two_rooms)
    assert (found.outcome, found.reason) == ("succeeded", "")
    assert found.distance_m > 1.0


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("navigation/scenario.osc", {}),
        ("navigation/nav_to_pose_single.osc", {}),
        ("navigation/nav_to_pose_multiple.osc", {f"goal_pose{k}": {"x": 1.0 + k % 3, "y": 1.0} for k in range(1, 6)}),
        ("navigation/nav_through_poses.osc", {"goal_poses": [{"x": 2.0, "y": 1.0}, {"x": 3.2, "y": 1.5}]}),
        ("examples/basic_nav/scenario.osc", {"start_pose": {"x": 0.0, "y": 0.0}}),
    ],
)
def test_scenario_of_robovasts_drives(two_rooms, name, given):
    file = UPSTREAM / name
    if not file.is_file():
        pytest.skip("RoboVAST's configurations are not beside the repository")
    found = driven(file, map_content(hall_file()) if "basic_nav" in name else two_rooms, **given)
    assert (found.outcome, found.reason) == ("succeeded", "")
    assert found.distance_m > 1.0
