"""AMCL by itself: the weight of a pose, and a filter driven from Python, on the closed loop's kernels."""

import functools

import numpy as np

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record, record_of
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.nav2.amcl import localization
from vastflow.sim.nav2.amcl.particles import new_cloud, points_for
from vastflow.sim.nav2.amcl.sensor import likelihood_cubed, usable_range_m, weigh
from vastflow.sim.nav2.navigator.state import MEMORY
from vastflow.sim.nav2.parameters.amcl import AmclParameters

PARAMETERS = np.dtype(
    [("amcl", record(AmclParameters())[0]), ("initial_covariance", np.float64, (4,))]
    + [(name, np.float64) for name in ("resolution", "origin_x", "origin_y")]
    + [(name, np.float64) for name in ("range_min", "range_max", "mount_x", "mount_y")],
    align=True,
)


@njit
def updated(parameters, memory, ranges_m, directions, cubed, cloud):
    localization.update(parameters[0], memory[0], ranges_m, directions, cubed, cloud)
    localization.estimate(memory[0])


@njit
def weighed(parameters, ranges_m, directions, cubed, cloud):
    weigh(parameters[0], 1, ranges_m, directions, cubed, cloud)


def record(q, resolution_m, origin_xy_m, laser_xyt):
    p = np.zeros(1, dtype=PARAMETERS)
    p["amcl"], p["resolution"] = record_of(q), resolution_m
    p["origin_x"], p["origin_y"] = origin_xy_m
    p["mount_x"], p["mount_y"], _ = laser_xyt
    return p


@functools.lru_cache(maxsize=4)
def known_table(walls, shape, resolution_m, q, range_max_m, dtype):
    """The table of one map, which takes far longer to make than a pose to weigh."""
    return likelihood_cubed(
        np.frombuffer(walls, dtype=np.bool_).reshape(shape),
        resolution_m,
        range_max_m=usable_range_m(q, 0.0, range_max_m)[1],
        z_hit=q.z_hit,
        z_rand=q.z_rand,
        sigma_hit_m=q.sigma_hit,
        likelihood_max_dist_m=q.laser_likelihood_max_dist,
        dtype=dtype,
    )


def table(occupied, resolution_m, q, range_max_m, dtype):
    walls = np.ascontiguousarray(occupied, dtype=np.bool_)
    return known_table(walls.tobytes(), walls.shape, resolution_m, q, range_max_m, dtype)


def directions(beams, angle_min_rad, angle_increment_rad, laser_yaw_rad):
    """(beams, 2) unit vectors of the beams in the robot's frame."""
    bearings_rad = laser_yaw_rad + angle_min_rad + angle_increment_rad * np.arange(beams)
    return np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad)])


def weight(
    *,
    pose_xyt,
    ranges_m,
    angle_min_rad,
    angle_increment_rad,
    range_min_m,
    range_max_m,
    laser_xyt,
    occupied,
    resolution_m,
    origin_xy_m,
    max_beams=60,
):
    """AMCL's weight of one pose under a scan, 1 + Σ pz³ over its beams, with numbers of eight bytes."""
    ranges = np.ascontiguousarray(ranges_m, dtype=np.float64)
    q = AmclParameters(max_particles=1, min_particles=1, max_beams=max_beams)
    p = record(q, resolution_m, origin_xy_m, laser_xyt)
    p["range_min"], p["range_max"] = range_min_m, range_max_m
    cubed = table(occupied, resolution_m, q, range_max_m, np.float64)
    cloud = new_cloud(1, beams=len(ranges), dtype=np.float64)
    cloud.particles[:, 0] = pose_xyt
    weighed(p, ranges, directions(len(ranges), angle_min_rad, angle_increment_rad, laser_xyt[2]), cubed, cloud)
    return float(cloud.likelihoods[0])


class Filter:
    """AMCL's particle filter on a map (H, W) of walls, fed with odometry and scans; `parameters` have Nav2's names."""

    def __init__(self, *, occupied, resolution_m, origin_xy_m, laser_xyt, seed, **parameters):
        self.parameters = AmclParameters(**parameters)
        self._occupied, self._resolution_m, self._laser_yaw_rad = occupied, resolution_m, laser_xyt[2]
        self._p = record(self.parameters, resolution_m, origin_xy_m, laser_xyt)
        self._m = np.zeros(1, dtype=MEMORY)
        self._m["streams"] = streams_of([seed])
        self._cloud = new_cloud(self.parameters.max_particles)

    @property
    def particles(self):
        """(N, 3) x, y, yaw of the particles; the yaw is not wrapped."""
        return np.ascontiguousarray(self._cloud.particles[:, : int(self._m["particles"][0])].T)

    @property
    def weights(self):
        """(N,) weights of the particles, their sum 1."""
        return np.array(self._cloud.weights[: int(self._m["particles"][0])])

    def set_pose(self, xyt, covariance):
        """Draw `max_particles` particles at a pose in the next update."""
        self._m["x"], self._m["y"], self._m["yaw"] = xyt
        matrix = np.diag(covariance) if np.ndim(covariance) == 1 else np.asarray(covariance)
        self._p["initial_covariance"] = matrix[0, 0], matrix[0, 1], matrix[1, 1], matrix[2, 2]
        self._m["first_scan"] = 1

    def update(self, odom_xyt, ranges_m, angle_min_rad, angle_increment_rad, range_min_m, range_max_m):
        """Update with a scan taken at a pose of the odometry: the pose and covariance that AMCL publishes, or None."""
        ranges = np.ascontiguousarray(ranges_m, dtype=np.float64)
        p, m = self._p[0], self._m[0]
        if self._cloud.points.shape[1] < points_for(len(ranges)):
            self._cloud = self._cloud._replace(points=np.zeros((2, points_for(len(ranges))), dtype=np.float32))
        p["range_min"], p["range_max"] = range_min_m, range_max_m
        for pose in ("odom_", "scan_odom_"):
            m[f"{pose}x"], m[f"{pose}y"], m[f"{pose}yaw"] = odom_xyt
        m["localized"] = 0
        bearings = directions(len(ranges), angle_min_rad, angle_increment_rad, self._laser_yaw_rad)
        cubed = table(self._occupied, self._resolution_m, self.parameters, range_max_m, np.float32)
        updated(self._p, self._m, ranges, bearings, cubed, self._cloud)
        if m["localized"] == 0:
            return None
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = [[m["pose_xx"], m["pose_xy"]], [m["pose_xy"], m["pose_yy"]]]
        covariance[2, 2] = m["pose_aa"]
        return np.array([m["x"], m["y"], m["yaw"]]), covariance
