"""The messages of one run: map, transforms, sensors, the stack's decisions, and the surroundings."""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.flows.export.mcap.bag import Bag
from vastflow.flows.export.mcap.topics import BASE, LASER, MAP, ODOM, TRUE_BASE
from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack
from vastflow.sim.loop.event_words import event_words
from vastflow.sim.model.pose import Pose, seen_from
from vastflow.sim.model.recording import Event
from vastflow.sim.model.shape import Disc
from vastflow.sim.replay import Moment, Patch, Published, TickSnapshot
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar

Fields: TypeAlias = dict[str, Any]
"""Fields of a message, see `Bag.add`."""
NODES: Final = {"following": "FollowPath", "spin": "Spin", "wait": "Wait", "back up": "BackUp"}
"""Activities to the nodes of Nav2's behavior trees that do them."""
CLEARS: Final = {
    "clear local costmap": ("ClearLocalCostmap-Context",),
    "clear global costmap": ("ClearGlobalCostmap-Context",),
    "clear both costmaps": ("ClearLocalCostmap-Subtree", "ClearGlobalCostmap-Subtree"),
}
"""Recoveries that take no time to the nodes of Nav2's default trees that do them, each of which Nav2 counts."""
_UIDS: Final = {
    name: k for k, name in enumerate((*NODES.values(), *(each for of in CLEARS.values() for each in of)), 1)
}
HEIGHT_M: Final = 0.5
"""Drawn height of what has none of its own."""
_COSTS: Final = np.array([0, *(1 + 97 * (cost - 1) // 251 for cost in range(1, 253)), 99, 100, -1], dtype=np.int8)
"""Costs of a costmap as occupancy, as Nav2's `costmap_2d_publisher.cpp` translates them."""
INFO, WARN = 20, 30
_CUBE, _SPHERE, _CYLINDER = 1, 2, 3
_ADD, _DELETE = 0, 2
_OBSTACLE, _MOVER, _CONTACT = (
    dict(zip("rgba", color, strict=True))
    for color in ((0.9, 0.5, 0.1, 0.9), (0.6, 0.2, 0.8, 0.9), (0.9, 0.1, 0.1, 1.0))
)


def nanoseconds(t_s: float) -> int:
    """Return a time of the run as bags count it; times are multiples of a millisecond."""
    return round(t_s * 1e3) * 1_000_000


class RunBag(Bag):
    """A bag with the messages of a run."""

    def __init__(self, without: Collection[str] = ()) -> None:
        super().__init__(without)
        self._node = ""
        self._goal = -1
        self._scan = 0
        self._odometry = Pose(0.0, 0.0)
        self._motion = (0.0, 0.0, 0.0)
        self._updates = -1
        self._global = b""

    def begins(self, occupancy: OccupancyMap | None, lidar: Lidar | None, start: Pose | None) -> None:
        """Add the map that the robot has, the place of its scanner, and its first pose."""
        if lidar is not None:
            self.add("/tf_static", 0, transforms=[_transform(0, BASE, LASER, Pose(*lidar.mount_xyt))])
        if occupancy is not None:
            corner = Pose(*occupancy.origin_xy_m, occupancy.yaw_rad)
            self.add("/map", 0, **_grid(0, MAP, occupancy.cells, occupancy.resolution_m, corner))
        if start is not None:
            self.add("/initialpose", 0, header=_header(0, MAP), pose={"pose": _pose(start)})

    def frames(self, t_s: float, map_odom: Pose, odometry: Pose, true: Pose | None) -> None:
        """Add the transforms of a time, and the time."""
        t_ns = nanoseconds(t_s)
        told = [(MAP, ODOM, map_odom), (ODOM, BASE, odometry), *([(MAP, TRUE_BASE, true)] if true else [])]
        self.add("/clock", t_ns, clock=_time(t_ns))
        self.add("/tf", t_ns, transforms=[_transform(t_ns, *each) for each in told])

    def truth(self, t_s: float, true: Pose, v_mps: float, vy_mps: float, w_radps: float) -> None:
        """Add where the robot truly is, and how it moves."""
        self._moved("/ground_truth/odom", t_s, MAP, TRUE_BASE, true, (v_mps, vy_mps, w_radps))

    def localized(self, t_s: float, estimate: Pose, covariance: NDArray[np.float64]) -> None:
        """Add a pose that AMCL published; `covariance` is xx, xy, yy (m²), and that of yaw (rad²)."""
        xx, xy, yy, yaw = covariance.tolist()
        full = np.zeros(36)
        full[[0, 1, 6, 7, 35]] = xx, xy, xy, yy, yaw
        t_ns = nanoseconds(t_s)
        self.add("/amcl_pose", t_ns, header=_header(t_ns, MAP), pose={"pose": _pose(estimate), "covariance": full})

    def commanded(self, t_s: float, topic: str, v_mps: float, vy_mps: float, w_radps: float) -> None:
        """Add a command of `/cmd_vel_nav`, the controller's, or of `/cmd_vel`, which the robot got."""
        self.add(topic, nanoseconds(t_s), **_twist(v_mps, vy_mps, w_radps))

    def sensed(self, moment: Moment, told: Published, lidar: Lidar) -> None:
        """Add transforms, odometry, and the scan if it is a new one.

        A scan is stamped when its first beam was measured, and written when the stack gets it.
        """
        t_s = moment.t_s
        self.frames(t_s, told.map_odom, self._odometry, moment.true)
        self._moved("/odom", t_s, ODOM, BASE, self._odometry, self._motion)
        self._odometry = told.odometry  # which is that of the next tick's time
        self._motion = told.speed_mps, told.lateral_mps, told.yaw_rate_radps
        if told.scan == self._scan:
            return
        self._scan = told.scan
        self.add(
            "/scan",
            nanoseconds(t_s),
            header=_header(nanoseconds(told.scan_t_s), LASER),
            angle_min=lidar.angle_min_rad,
            angle_max=lidar.angle_max_rad,
            angle_increment=lidar.angle_increment_rad,
            time_increment=abs(lidar.angle_increment_rad) / (math.tau * lidar.rate_hz) if lidar.sweeps else 0.0,
            scan_time=1.0 / lidar.rate_hz,
            range_min=lidar.range_min_m,
            range_max=lidar.range_max_m,
            ranges=np.where(told.ranges_m < lidar.range_max_m, told.ranges_m, np.inf).astype(np.float32),
        )

    def doing(self, moment: Moment) -> None:
        """Add the change of what the robot does, as a change of the nodes of a behavior tree."""
        node = NODES.get(moment.activity, "")
        if node == self._node:
            return
        self._changed(nanoseconds(moment.t_s), (self._node, "RUNNING", "IDLE"), (node, "IDLE", "RUNNING"))
        self._node = node

    def _changed(self, t_ns: int, *changes: tuple[str, str, str]) -> None:
        """Add names of nodes with their status before and now, as one log of the behavior tree."""
        log = [
            {
                "timestamp": _time(t_ns),
                "node_name": name,
                "uid": _UIDS[name],
                "previous_status": before,
                "current_status": now,
            }
            for name, before, now in changes
            if name
        ]
        self.add("/behavior_tree_log", t_ns, timestamp=_time(t_ns), event_log=log)

    def seen(self, snapshot: TickSnapshot, told: Published, *, has_local: bool, has_global: bool) -> None:
        """Add goal, paths, particles, and costmaps.

        Args:
            has_local, has_global: Whether the costmaps are published now.
        """
        moment = snapshot.moment
        t_ns = nanoseconds(moment.t_s)
        header = _header(t_ns, MAP)
        if moment.goal != self._goal and moment.goal < len(snapshot.goals):
            self._goal = moment.goal
            self.add("/goal_pose", t_ns, header=header, pose=_pose(snapshot.goals[self._goal]))
        for topic, xy_m in (
            ("/plan", snapshot.plan_xy_m),
            ("/transformed_global_plan", snapshot.ahead_xy_m),
            ("/optimal_trajectory", snapshot.intended_xy_m),
        ):
            if len(xy_m):
                self.add(topic, t_ns, header=header, poses=_along(header, xy_m))
        particles = snapshot.particles.tolist()
        if told.updates != self._updates and particles:
            self._updates = told.updates
            cloud = [{"pose": _pose(Pose(*each)), "weight": 1.0 / len(particles)} for each in particles]
            self.add("/particle_cloud", t_ns, header=header, particles=cloud)
        if has_local and (patch := snapshot.local_costs) is not None:
            corner, robot = (seen_from(each, told.map_odom) for each in (patch.corner, moment.estimate))
            self.add("/local_costmap/costmap", t_ns, **_costmap(t_ns, ODOM, patch, corner))
            c, s = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
            outline = snapshot.outline_m @ np.array([[c, s], [-s, c]]) + (robot.x_m, robot.y_m)
            polygon = {"points": [{"x": x_m, "y": y_m} for x_m, y_m in outline.tolist()]}
            self.add("/local_costmap/published_footprint", t_ns, header=_header(t_ns, ODOM), polygon=polygon)
        if has_global and (content := snapshot.global_costs.costs.tobytes()) != self._global:
            self._global = content
            patch = snapshot.global_costs
            self.add("/global_costmap/costmap", t_ns, **_costmap(t_ns, MAP, patch, patch.corner))

    def surroundings(self, tracks: Iterable[ObstacleTrack], events: Iterable[Event], end_ms: int) -> None:
        """Add obstacles and movers as markers, contacts as spheres, and what happened in words."""
        for number, track in enumerate(tracks):
            topic, color = ("/ground_truth/movers", _MOVER) if track.moves else ("/ground_truth/obstacles", _OBSTACLE)
            shape, name = track.obstacle.shape, track.obstacle.name
            size_m = (2 * shape.radius_m,) * 2 if isinstance(shape, Disc) else (shape.length_m, shape.width_m)
            kind, was_there = _CYLINDER if isinstance(shape, Disc) else _CUBE, False
            for since_ms, xy_m, yaw_rad in zip(
                track.since_ms.tolist(), track.xy_m.tolist(), track.yaw_rad.tolist(), strict=True
            ):
                is_there = all(map(math.isfinite, xy_m))
                if since_ms <= end_ms and (is_there or was_there):
                    pose = Pose(xy_m[0], xy_m[1], yaw_rad) if is_there else None
                    self._marked(
                        topic, max(since_ms, 0) * 1_000_000, name, number, kind, pose, (*size_m, HEIGHT_M), color
                    )
                was_there = is_there
        for number, event in enumerate(events):
            t_ns = nanoseconds(event.t_s)
            if event.kind == "contact":
                place = Pose(event.x_m, event.y_m)
                self._marked(
                    "/ground_truth/contacts", t_ns, "contacts", number, _SPHERE, place, (0.2, 0.2, 0.2), _CONTACT
                )
            for node in CLEARS.get(event.what, (NODES.get(event.what, ""),)) if event.kind == "recovery" else ():
                if event.what in CLEARS:
                    self._changed(t_ns, (node, "IDLE", "RUNNING"), (node, "RUNNING", "SUCCESS"))
                elif not self._scan:  # nothing was executed, and so `doing` told nothing
                    self._changed(t_ns, (node, "IDLE", "RUNNING"))
            if words := event_words(event):
                self.says(t_ns, words, INFO if event.kind == "goal_reached" else WARN)

    def says(self, t_ns: int, words: str, level: int = INFO) -> None:
        """Add a line of the log."""
        self.add("/rosout", t_ns, stamp=_time(t_ns), level=level, name="vastflow", msg=words)

    def _moved(
        self, topic: str, t_s: float, frame: str, child: str, pose: Pose, motion: tuple[float, float, float]
    ) -> None:
        t_ns, twist = nanoseconds(t_s), {"twist": _twist(*motion)}
        place = {"pose": _pose(pose)}
        self.add(topic, t_ns, header=_header(t_ns, frame), child_frame_id=child, pose=place, twist=twist)

    def _marked(
        self,
        topic: str,
        t_ns: int,
        name: str,
        number: int,
        kind: int,
        pose: Pose | None,
        size_m: tuple[float, float, float],
        color: Mapping[str, float],
    ) -> None:
        marker = {
            "header": _header(t_ns, MAP),
            "ns": name,
            "id": number,
            "type": kind,
            "action": _DELETE if pose is None else _ADD,
            "pose": _pose(pose or Pose(0.0, 0.0), size_m[2] / 2),
            "scale": dict(zip("xyz", size_m, strict=True)),
            "color": color,
            "text": name,
        }
        self.add(topic, t_ns, markers=[marker])


def _time(t_ns: int) -> Fields:
    return {"sec": t_ns // 1_000_000_000, "nanosec": t_ns % 1_000_000_000}


def _header(t_ns: int, frame: str) -> Fields:
    return {"stamp": _time(t_ns), "frame_id": frame}


def _turn(yaw_rad: float) -> Fields:
    return {"z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)}


def _pose(pose: Pose, z_m: float = 0.0) -> Fields:
    return {"position": {"x": pose.x_m, "y": pose.y_m, "z": z_m}, "orientation": _turn(pose.yaw_rad)}


def _transform(t_ns: int, parent: str, child: str, pose: Pose) -> Fields:
    transform = {"translation": {"x": pose.x_m, "y": pose.y_m}, "rotation": _turn(pose.yaw_rad)}
    return {"header": _header(t_ns, parent), "child_frame_id": child, "transform": transform}


def _twist(v_mps: float, vy_mps: float, w_radps: float) -> Fields:
    return {"linear": {"x": v_mps, "y": vy_mps}, "angular": {"z": w_radps}}


def _along(header: Fields, xy_m: NDArray[np.float64]) -> list[Fields]:
    """Return the poses of a path, each turned to the next point."""
    ahead = np.diff(xy_m, axis=0, append=xy_m[-1:])
    if len(xy_m) > 1:
        ahead[-1] = ahead[-2]
    poses = np.column_stack([xy_m, np.arctan2(ahead[:, 1], ahead[:, 0])]).tolist()
    return [{"header": header, "pose": _pose(Pose(*each))} for each in poses]


def _costmap(t_ns: int, frame: str, patch: Patch, corner: Pose) -> Fields:
    return _grid(t_ns, frame, _COSTS[patch.costs], patch.resolution_m, corner)


def _grid(t_ns: int, frame: str, cells: NDArray[np.int8], resolution_m: float, corner: Pose) -> Fields:
    rows, columns = cells.shape
    info = {"resolution": resolution_m, "width": columns, "height": rows, "origin": _pose(corner)}
    data = np.ascontiguousarray(cells, dtype=np.int8).ravel()
    return {"header": _header(t_ns, frame), "info": info, "data": data}
