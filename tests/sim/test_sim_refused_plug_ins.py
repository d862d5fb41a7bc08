"""Missions of files whose plug-ins have other names than Nav2's behavior trees ask for."""

import numpy as np
from driving import drive
from table import each_row

from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameters.servers import ControllerServer, PlannerServer
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.system.robot import robot_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.world import World


@each_row(
    ("server", "code", "kind", "told"),
    [
        (ControllerServer, 101, "navigate_to_pose", 101),
        (ControllerServer, 101, "follow_waypoints", 101),
        (PlannerServer, 201, "navigate_to_pose", 201),
        (PlannerServer, 201, "navigate_through_poses", 301),
    ],
)
def test_mission_aborts_without_a_recovery_where_nav2_finds_no_plug_in(server, code, kind, told):
    name = {ControllerServer: "controller_server", PlannerServer: "planner_server"}[server]
    parameters = NavParameters().with_values(**{name: server(refusal=code)})
    cells = np.zeros((60, 120), dtype=np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    prepared = prepare(World(OccupancyMap(cells, 0.05, (0.0, 0.0))), Lidar(), parameters)
    mission, start = Mission(kind, (Pose(4.0, 1.5, 0.0), Pose(5.0, 1.5, 0.0))), Pose(1.0, 1.5, 0.0)
    if kind == "navigate_to_pose":
        mission = Mission(kind, mission.goals[:1])
    run = drive(prepared, parameters, Lidar(), robot_of(parameters), start, mission, (), (1, 2, 3), 30.0).run
    failed = [int(event.what) for event in run.events if event.kind.endswith("_failed")]
    assert failed == [told] * (2 if kind == "follow_waypoints" else 1)
    assert (run.recoveries, run.distance_m < 0.01, run.simulated_s < 2.0) == (0, True, True)
    assert run.outcome == ("succeeded" if kind == "follow_waypoints" else "aborted")
