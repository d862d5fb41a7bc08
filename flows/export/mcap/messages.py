"""The messages of one run: map, transforms, sensors, the stack's decisions, and the surroundings."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.flows.export.mcap.bag import Bag
from vastflow.flows.export.mcap.topics import BASE, LASER, MAP, ODOM, TRUE_BASE
from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack
from vastflow.sim.loop.event_words import event_words
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event
from vastflow.sim.model.shape import Disc
from vastflow.sim.replay import Moment, Patch, Published, TickSnapshot
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar

NODES: Final = {"following": "FollowPath", "spin": "Spin", "wait": "Wait", "back up": "BackUp"}
"""Activities to the nodes of Nav2's behavior trees that do them."""
HEIGHT_M: Final = 0.5
"""Drawn height of what has none of its own."""
_COSTS: Final = np.array([0, *(1 + 97 * (cost - 1) // 251 for cost in range(1, 253)), 99, 100, -1], dtype=np.int8)
"""Costs of a costmap as occupancy, as Nav2's `costmap_2d_publisher.cpp` translates them."""
INFO, WARN = 20, 30
_CUBE, _SPHERE, _CYLINDER = 1, 2, 3
_ADD, _DELETE = 0, 2
_OBSTACLE, _MOVER, _CONTACT = (0.9, 0.5, 0.1, 0.9), (0.6, 0.2, 0.8, 0.9), (0.9, 0.1, 0.1, 1.0)


def nanoseconds(t_s: float) -> int:
    """Return a time of the run as bags count it; times are multiples of a millisecond."""
    return round(t_s * 1e3) * 1_000_000


class RunMessages:
    """Fills a bag with the messages of a run."""

    def __init__(self, bag: Bag) -> None:
        self._bag, self._make = bag, bag.make
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
            mount = self._transform(0, BASE, LASER, Pose(*lidar.mount_xyt))
            self._bag.add("/tf_static", 0, self._make("tf2_msgs/TFMessage", transforms=[mount]))
        if occupancy is not None:
            corner = Pose(*occupancy.origin_xy_m, occupancy.yaw_rad)
            self._bag.add("/map", 0, self._grid(0, MAP, occupancy.cells, occupancy.resolution_m, corner))
        if start is not None:
            self._bag.add("/initialpose", 0, self._estimated(0, start, np.zeros(4)))

    def frames(self, t_s: float, map_odom: Pose, odometry: Pose, true: Pose) -> None:
        """Add the transforms of a time, and the time."""
        t_ns = nanoseconds(t_s)
        told = [(MAP, ODOM, map_odom), (ODOM, BASE, odometry), (MAP, TRUE_BASE, true)]
        transforms = [self._transform(t_ns, *each) for each in told]
        self._bag.add("/clock", t_ns, self._make("rosgraph_msgs/Clock", clock=self._time(t_ns)))
        self._bag.add("/tf", t_ns, self._make("tf2_msgs/TFMessage", transforms=transforms))

    def truth(self, t_s: float, true: Pose, v_mps: float, vy_mps: float, w_radps: float) -> None:
        """Add where the robot truly is, and how it moves."""
        self._bag.add(
            "/ground_truth/odom", nanoseconds(t_s), self._moved(t_s, MAP, TRUE_BASE, true, (v_mps, vy_mps, w_radps))
        )

    def localized(self, t_s: float, estimate: Pose, covariance: NDArray[np.float64]) -> None:
        """Add a pose that AMCL published; `covariance` is xx, xy, yy (m²), and that of yaw (rad²)."""
        self._bag.add("/amcl_pose", nanoseconds(t_s), self._estimated(nanoseconds(t_s), estimate, covariance))

    def commanded(self, t_s: float, topic: str, v_mps: float, vy_mps: float, w_radps: float) -> None:
        """Add a command of `/cmd_vel_nav`, the controller's, or of `/cmd_vel`, which the robot got."""
        self._bag.add(topic, nanoseconds(t_s), self._twist(v_mps, vy_mps, w_radps))

    def sensed(self, moment: Moment, told: Published, lidar: Lidar) -> None:
        """Add transforms, odometry, and the scan if it is a new one.

        A scan is stamped when its first beam was measured, and written when the stack gets it.
        """
        t_s = moment.t_s
        self.frames(t_s, told.map_odom, self._odometry, moment.true)
        self._bag.add("/odom", nanoseconds(t_s), self._moved(t_s, ODOM, BASE, self._odometry, self._motion))
        self._odometry = told.odometry  # which is that of the next tick's time
        self._motion = told.speed_mps, told.lateral_mps, told.yaw_rate_radps
        if told.scan == self._scan:
            return
        self._scan = told.scan
        ranges = np.where(told.ranges_m < lidar.range_max_m, told.ranges_m, np.inf).astype(np.float32)
        scan = self._make(
            "sensor_msgs/LaserScan",
            header=self._header(nanoseconds(told.scan_t_s), LASER),
            angle_min=lidar.angle_min_rad,
            angle_max=lidar.angle_max_rad,
            angle_increment=lidar.angle_increment_rad,
            time_increment=abs(lidar.angle_increment_rad) / (math.tau * lidar.rate_hz) if lidar.sweeps else 0.0,
            scan_time=1.0 / lidar.rate_hz,
            range_min=lidar.range_min_m,
            range_max=lidar.range_max_m,
            ranges=ranges,
            intensities=np.zeros(0, dtype=np.float32),
        )
        self._bag.add("/scan", nanoseconds(t_s), scan)

    def doing(self, moment: Moment) -> None:
        """Add the change of what the robot does, as a change of the nodes of a behavior tree."""
        node = NODES.get(moment.activity, "")
        if node == self._node:
            return
        t_ns = nanoseconds(moment.t_s)
        changes = [(self._node, "RUNNING", "IDLE"), (node, "IDLE", "RUNNING")]
        log = [
            self._make(
                "nav2_msgs/BehaviorTreeStatusChange",
                timestamp=self._time(t_ns),
                node_name=name,
                uid=1 + list(NODES.values()).index(name),
                previous_status=before,
                current_status=now,
            )
            for name, before, now in changes
            if name
        ]
        self._node = node
        self._bag.add(
            "/behavior_tree_log",
            t_ns,
            self._make("nav2_msgs/BehaviorTreeLog", timestamp=self._time(t_ns), event_log=log),
        )

    def seen(self, snapshot: TickSnapshot, told: Published, *, has_local: bool, has_global: bool) -> None:
        """Add goal, paths, particles, and costmaps.

        Args:
            has_local, has_global: Whether the costmaps are published now.
        """
        moment = snapshot.moment
        t_ns = nanoseconds(moment.t_s)
        if moment.goal != self._goal and moment.goal < len(snapshot.goals):
            self._goal = moment.goal
            goal = self._make(
                "geometry_msgs/PoseStamped", header=self._header(t_ns, MAP), pose=self._pose(snapshot.goals[self._goal])
            )
            self._bag.add("/goal_pose", t_ns, goal)
        for topic, xy_m in (
            ("/plan", snapshot.plan_xy_m),
            ("/transformed_global_plan", snapshot.ahead_xy_m),
            ("/optimal_trajectory", snapshot.intended_xy_m),
        ):
            if len(xy_m):
                self._bag.add(topic, t_ns, self._path(t_ns, xy_m))
        if told.updates != self._updates and len(snapshot.particles):
            self._updates = told.updates
            self._bag.add("/particle_cloud", t_ns, self._cloud(t_ns, snapshot.particles))
        if has_local and snapshot.local_costs is not None:
            patch = snapshot.local_costs
            corner = _seen_from(told.map_odom, patch.corner)
            self._bag.add("/local_costmap/costmap", t_ns, self._costmap(t_ns, ODOM, patch, corner))
            self._bag.add(
                "/local_costmap/published_footprint",
                t_ns,
                self._footprint(t_ns, snapshot.outline_m, _seen_from(told.map_odom, moment.estimate)),
            )
        if has_global and (content := snapshot.global_costs.costs.tobytes()) != self._global:
            self._global = content
            patch = snapshot.global_costs
            self._bag.add("/global_costmap/costmap", t_ns, self._costmap(t_ns, MAP, patch, patch.corner))

    def surroundings(self, tracks: Iterable[ObstacleTrack], events: Iterable[Event], end_ms: int) -> None:
        """Add obstacles and movers as markers, contacts as spheres, and what happened in words."""
        for number, track in enumerate(tracks):
            topic, color = ("/ground_truth/movers", _MOVER) if track.moves else ("/ground_truth/obstacles", _OBSTACLE)
            was_there = False
            for since_ms, xy_m, yaw_rad in zip(
                track.since_ms.tolist(), track.xy_m, track.yaw_rad.tolist(), strict=True
            ):
                is_there = bool(np.isfinite(xy_m).all())
                if since_ms <= end_ms and (is_there or was_there):
                    t_ns = max(since_ms, 0) * 1_000_000
                    pose = Pose(float(xy_m[0]), float(xy_m[1]), yaw_rad) if is_there else None
                    self._bag.add(topic, t_ns, self._markers(t_ns, track, number, pose, color))
                was_there = is_there
        for number, event in enumerate(events):
            t_ns = nanoseconds(event.t_s)
            if event.kind == "contact":
                place = Pose(event.x_m, event.y_m)
                sphere = self._marker(t_ns, "contacts", number, _SPHERE, place, (0.2, 0.2, 0.2), _CONTACT)
                self._bag.add(
                    "/ground_truth/contacts", t_ns, self._make("visualization_msgs/MarkerArray", markers=[sphere])
                )
            if words := event_words(event):
                self.says(t_ns, words, INFO if event.kind == "goal_reached" else WARN)

    def says(self, t_ns: int, words: str, level: int = INFO) -> None:
        """Add a line of the log."""
        log = self._make(
            "rcl_interfaces/Log",
            stamp=self._time(t_ns),
            level=level,
            name="vastflow",
            msg=words,
            file="",
            function="",
            line=0,
        )
        self._bag.add("/rosout", t_ns, log)

    def _time(self, t_ns: int) -> Any:
        return self._make("builtin_interfaces/Time", sec=t_ns // 1_000_000_000, nanosec=t_ns % 1_000_000_000)

    def _header(self, t_ns: int, frame: str) -> Any:
        return self._make("std_msgs/Header", stamp=self._time(t_ns), frame_id=frame)

    def _turn(self, yaw_rad: float) -> Any:
        return self._make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2))

    def _pose(self, pose: Pose, z_m: float = 0.0) -> Any:
        position = self._make("geometry_msgs/Point", x=pose.x_m, y=pose.y_m, z=z_m)
        return self._make("geometry_msgs/Pose", position=position, orientation=self._turn(pose.yaw_rad))

    def _vector(self, x: float, y: float, z: float) -> Any:
        return self._make("geometry_msgs/Vector3", x=x, y=y, z=z)

    def _transform(self, t_ns: int, parent: str, child: str, pose: Pose) -> Any:
        place = self._vector(pose.x_m, pose.y_m, 0.0)
        transform = self._make("geometry_msgs/Transform", translation=place, rotation=self._turn(pose.yaw_rad))
        return self._make(
            "geometry_msgs/TransformStamped",
            header=self._header(t_ns, parent),
            child_frame_id=child,
            transform=transform,
        )

    def _twist(self, v_mps: float, vy_mps: float, w_radps: float) -> Any:
        linear, angular = self._vector(v_mps, vy_mps, 0.0), self._vector(0.0, 0.0, w_radps)
        return self._make("geometry_msgs/Twist", linear=linear, angular=angular)

    def _moved(self, t_s: float, frame: str, child: str, pose: Pose, motion: tuple[float, float, float]) -> Any:
        nothing = np.zeros(36)
        return self._make(
            "nav_msgs/Odometry",
            header=self._header(nanoseconds(t_s), frame),
            child_frame_id=child,
            pose=self._make("geometry_msgs/PoseWithCovariance", pose=self._pose(pose), covariance=nothing),
            twist=self._make("geometry_msgs/TwistWithCovariance", twist=self._twist(*motion), covariance=nothing),
        )

    def _estimated(self, t_ns: int, pose: Pose, covariance: NDArray[np.float64]) -> Any:
        xx, xy, yy, yaw = covariance.tolist()
        full = np.zeros(36)
        full[[0, 1, 6, 7, 35]] = xx, xy, xy, yy, yaw
        estimate = self._make("geometry_msgs/PoseWithCovariance", pose=self._pose(pose), covariance=full)
        return self._make("geometry_msgs/PoseWithCovarianceStamped", header=self._header(t_ns, MAP), pose=estimate)

    def _path(self, t_ns: int, xy_m: NDArray[np.float64]) -> Any:
        ahead = np.diff(xy_m, axis=0, append=xy_m[-1:])
        if len(xy_m) > 1:
            ahead[-1] = ahead[-2]
        yaws_rad = np.arctan2(ahead[:, 1], ahead[:, 0]).tolist()
        header = self._header(t_ns, MAP)
        poses = [
            self._make("geometry_msgs/PoseStamped", header=header, pose=self._pose(Pose(x_m, y_m, yaw_rad)))
            for (x_m, y_m), yaw_rad in zip(xy_m.tolist(), yaws_rad, strict=True)
        ]
        return self._make("nav_msgs/Path", header=header, poses=poses)

    def _cloud(self, t_ns: int, particles: NDArray[np.float64]) -> Any:
        told = [
            self._make("nav2_msgs/Particle", pose=self._pose(Pose(x_m, y_m, yaw_rad)), weight=1.0 / len(particles))
            for x_m, y_m, yaw_rad in particles.tolist()
        ]
        return self._make("nav2_msgs/ParticleCloud", header=self._header(t_ns, MAP), particles=told)

    def _costmap(self, t_ns: int, frame: str, patch: Patch, corner: Pose) -> Any:
        return self._grid(t_ns, frame, _COSTS[patch.costs], patch.resolution_m, corner)

    def _grid(self, t_ns: int, frame: str, cells: NDArray[np.int8], resolution_m: float, corner: Pose) -> Any:
        rows, columns = cells.shape
        info = self._make(
            "nav_msgs/MapMetaData",
            map_load_time=self._time(0),
            resolution=resolution_m,
            width=columns,
            height=rows,
            origin=self._pose(corner),
        )
        data = np.ascontiguousarray(cells, dtype=np.int8).ravel()
        return self._make("nav_msgs/OccupancyGrid", header=self._header(t_ns, frame), info=info, data=data)

    def _footprint(self, t_ns: int, outline_m: NDArray[np.float64], pose: Pose) -> Any:
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        placed = outline_m @ np.array([[c, s], [-s, c]]) + (pose.x_m, pose.y_m)
        points = [self._make("geometry_msgs/Point32", x=x_m, y=y_m, z=0.0) for x_m, y_m in placed.tolist()]
        polygon = self._make("geometry_msgs/Polygon", points=points)
        return self._make("geometry_msgs/PolygonStamped", header=self._header(t_ns, ODOM), polygon=polygon)

    def _markers(self, t_ns: int, track: ObstacleTrack, number: int, pose: Pose | None, color: Sequence[float]) -> Any:
        shape = track.obstacle.shape
        if isinstance(shape, Disc):
            kind, size_m = _CYLINDER, (2 * shape.radius_m, 2 * shape.radius_m, HEIGHT_M)
        else:
            kind, size_m = _CUBE, (shape.length_m, shape.width_m, HEIGHT_M)
        marker = self._marker(t_ns, track.obstacle.name, number, kind, pose, size_m, color)
        return self._make("visualization_msgs/MarkerArray", markers=[marker])

    def _marker(
        self,
        t_ns: int,
        name: str,
        number: int,
        kind: int,
        pose: Pose | None,
        size_m: tuple[float, float, float],
        color: Sequence[float],
    ) -> Any:
        r, g, b, a = color
        never, nothing = self._make("builtin_interfaces/Duration", sec=0, nanosec=0), self._time(0)
        picture_header = self._make("std_msgs/Header", stamp=nothing, frame_id="")
        no_bytes = np.zeros(0, dtype=np.uint8)
        return self._make(
            "visualization_msgs/Marker",
            header=self._header(t_ns, MAP),
            ns=name,
            id=number,
            type=kind,
            action=_DELETE if pose is None else _ADD,
            pose=self._pose(pose or Pose(0.0, 0.0), size_m[2] / 2),
            scale=self._vector(*size_m),
            color=self._make("std_msgs/ColorRGBA", r=r, g=g, b=b, a=a),
            lifetime=never,
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=self._make("sensor_msgs/CompressedImage", header=picture_header, format="", data=no_bytes),
            uv_coordinates=[],
            text=name,
            mesh_resource="",
            mesh_file=self._make("visualization_msgs/MeshFile", filename="", data=no_bytes),
            mesh_use_embedded_materials=False,
        )


def _seen_from(frame: Pose, pose: Pose) -> Pose:
    """Return a pose in a frame whose own pose is given in the same frame as the pose."""
    x_m, y_m = pose.x_m - frame.x_m, pose.y_m - frame.y_m
    c, s = math.cos(frame.yaw_rad), math.sin(frame.yaw_rad)
    return Pose(c * x_m + s * y_m, c * y_m - s * x_m, pose.yaw_rad - frame.yaw_rad)
