"""AMCL, Nav2's localization, by itself: the weight of one pose, and a filter that is fed from Python.

Both run the kernels of the closed loop, see `vastflow.sim.nav2.amcl.particles` and `vastflow.sim.nav2.amcl.localization`.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_dtype, record_of
from vastflow.sim.kernels.streams import SUBSYSTEMS, streams_of
from vastflow.sim.model.parameter import complaints
from vastflow.sim.nav2.amcl import localization
from vastflow.sim.nav2.amcl.particles import Cloud, new_cloud, points_for
from vastflow.sim.nav2.amcl.sensor import likelihood_cubed, usable_range_m, weigh
from vastflow.sim.nav2.parameters.amcl import AmclParameters, covariance_of

Pose = Sequence[float]
"""x, y (m) and yaw (rad)."""

_PARAMETERS: Final = np.dtype(
    [("amcl", record_dtype(AmclParameters())), ("initial_covariance", np.float64, (4,))]
    + [(name, np.float64) for name in ("resolution", "origin_x", "origin_y")]
    + [(name, np.float64) for name in ("range_min", "range_max", "mount_x", "mount_y")],
    align=True,
)
_MEMORY: Final = np.dtype(
    [(name, np.int64) for name in ("first_scan", "particles", "bins", "localized", "filter_updates")]
    + [(name, np.float64) for name in ("x", "y", "yaw", "odom_x", "odom_y", "odom_yaw")]
    + [(name, np.float64) for name in ("scan_odom_x", "scan_odom_y", "scan_odom_yaw")]
    + [(name, np.float64) for name in ("filter_odom_x", "filter_odom_y", "filter_odom_yaw")]
    + [(name, np.float64) for name in ("map_odom_x", "map_odom_y", "map_odom_yaw")]
    + [(name, np.float64) for name in ("pose_xx", "pose_xy", "pose_yy", "pose_aa")]
    + [("streams", np.uint64, (SUBSYSTEMS, 1))],
    align=True,
)
"""The part of the closed loop's records that localization reads and writes."""


def weight(
    *,
    pose_xyt: Pose,
    ranges_m: ArrayLike,
    angle_min_rad: float,
    angle_increment_rad: float,
    range_min_m: float,
    range_max_m: float,
    laser_xyt: Pose,
    occupied: ArrayLike,
    resolution_m: float,
    origin_xy_m: Sequence[float],
    max_beams: int = 60,
    z_hit: float = 0.5,
    z_rand: float = 0.5,
    sigma_hit_m: float = 0.2,
    likelihood_max_dist_m: float = 2.0,
) -> float:
    """AMCL's unnormalized weight of one pose under a scan: 1 + Σ pz³ over the beams it uses (likelihood_field).

    Args:
        pose_xyt: The robot's pose in the map.
        ranges_m: (N,) one scan; `inf`, NaN and what lies at or beyond `range_max_m` are skipped.
        range_max_m: Greatest usable range: the scanner's, or `laser_max_range` where that is less.
        laser_xyt: The scanner's pose on the robot.
        occupied: (H, W), true where the map has a wall; row 0 at the lowest y.
        origin_xy_m: Map position of the lower left corner of cell (0, 0).

    Raises:
        ValueError: a parameter out of range.
        ValueError: an array of another shape.
    """
    ranges = _ranges_of(ranges_m)
    q = _parameters_of(
        {
            "max_particles": 1,
            "min_particles": 1,
            "max_beams": max_beams,
            "z_hit": z_hit,
            "z_rand": z_rand,
            "sigma_hit": sigma_hit_m,
            "laser_likelihood_max_dist": likelihood_max_dist_m,
        }
    )
    p = _record(q, resolution_m, origin_xy_m, laser_xyt)
    p["range_min"], p["range_max"] = range_min_m, range_max_m
    # The closed loop looks beams up with four-byte numbers; here all is done with eight.
    cubed = _table(_walls_of(occupied), resolution_m, q, range_max_m, double=True)
    cloud = new_cloud(1, beams=len(ranges), dtype=np.float64)
    cloud.particles[:, 0] = _pose_of(pose_xyt, "pose_xyt")
    directions = _directions(len(ranges), angle_min_rad, angle_increment_rad, laser_xyt[2])
    _weigh_one(p, ranges, directions, cubed, cloud)
    return float(cloud.likelihoods[0])


class Filter:
    """AMCL's particle filter, fed with odometry and scans.

    Args:
        occupied: (H, W), true where the map has a wall; row 0 at the lowest y.
        origin_xy_m: Map position of the lower left corner of cell (0, 0).
        laser_xyt: The scanner's pose on the robot.
        seed: Same seed and same calls give the same particles.
        parameters: Under Nav2's names, see `AmclParameters`; its defaults otherwise.

    Raises:
        ValueError: a parameter that is unknown, of the wrong type or out of range.
        ValueError: an array of another shape.
    """

    def __init__(
        self,
        *,
        occupied: ArrayLike,
        resolution_m: float,
        origin_xy_m: Sequence[float],
        laser_xyt: Pose,
        seed: int,
        **parameters: Any,
    ) -> None:
        self.parameters: Final = _parameters_of(parameters)
        self._occupied = _walls_of(occupied)
        self._laser_yaw_rad = float(laser_xyt[2])
        self._p = _record(self.parameters, resolution_m, origin_xy_m, laser_xyt)
        self._m = np.zeros(1, dtype=_MEMORY)
        self._m["streams"] = streams_of([seed])
        self._cloud = new_cloud(self.parameters.max_particles)
        self._cubed = np.zeros((0, 0), dtype=np.float32)
        self._placed = False

    @property
    def particles(self) -> NDArray[np.float64]:
        """(N, 3) x, y, yaw of the particles as they are now; the yaw is not wrapped."""
        return np.ascontiguousarray(self._cloud.particles[:, : int(self._m["particles"][0])].T)

    @property
    def weights(self) -> NDArray[np.float64]:
        """(N,) weights of the particles, their sum 1."""
        return np.array(self._cloud.weights[: int(self._m["particles"][0])])

    def set_pose(self, xyt: Pose, covariance: Any) -> None:
        """Begin anew at a pose: the next update draws `max_particles` particles there.

        Args:
            covariance: (3, 3) of x, y, yaw, or its diagonal (3,); as in AMCL, yaw is drawn independently of x and y.

        Raises:
            ValueError: it is no covariance.
            ValueError: `xyt` is not three finite numbers.
        """
        pose, drawn = _pose_of(xyt, "xyt"), covariance_of(covariance, "covariance")
        self._m["x"], self._m["y"], self._m["yaw"] = pose
        self._p["initial_covariance"] = drawn
        self._m["first_scan"] = 1
        self._placed = True

    def update(
        self,
        odom_xyt: Pose,
        ranges_m: ArrayLike,
        angle_min_rad: float,
        angle_increment_rad: float,
        range_min_m: float,
        range_max_m: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """One scan, taken at a pose of the odometry.

        The first one after `set_pose` weighs and resamples the particles where they are drawn; later ones do nothing
        until the robot has moved by `update_min_d` or turned by `update_min_a`.

        Returns:
            The pose (3,) that AMCL publishes and its covariance (3, 3), or None when it publishes none.

        Raises:
            ValueError: no pose was set, or an argument is of another shape.
        """
        if not self._placed:
            raise ValueError("no initial pose: call set_pose before update")
        ranges = _ranges_of(ranges_m)
        p, m = self._p[0], self._m[0]
        if self._cloud.points.shape[1] < points_for(len(ranges)):
            self._cloud = self._cloud._replace(points=np.zeros((2, points_for(len(ranges))), dtype=np.float32))
        if self._cubed.size == 0 or range_max_m != p["range_max"]:
            self._cubed = _table(self._occupied, float(p["resolution"]), self.parameters, range_max_m, double=False)
        p["range_min"], p["range_max"] = range_min_m, range_max_m
        m["odom_x"], m["odom_y"], m["odom_yaw"] = _pose_of(odom_xyt, "odom_xyt")
        m["scan_odom_x"], m["scan_odom_y"], m["scan_odom_yaw"] = m["odom_x"], m["odom_y"], m["odom_yaw"]
        m["localized"] = 0
        directions = _directions(len(ranges), angle_min_rad, angle_increment_rad, self._laser_yaw_rad)
        _update(self._p, self._m, ranges, directions, self._cubed, self._cloud)
        if m["localized"] == 0:
            return None
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = [[m["pose_xx"], m["pose_xy"]], [m["pose_xy"], m["pose_yy"]]]
        covariance[2, 2] = m["pose_aa"]
        return np.array([m["x"], m["y"], m["yaw"]]), covariance


@njit
def _update(parameters: Any, memory: Any, ranges_m: Any, directions: Any, cubed: Any, cloud: Cloud) -> None:
    localization.update(parameters[0], memory[0], ranges_m, directions, cubed, cloud)
    localization.estimate(memory[0])


@njit
def _weigh_one(parameters: Any, ranges_m: Any, directions: Any, cubed: Any, cloud: Cloud) -> None:
    weigh(parameters[0], 1, ranges_m, directions, cubed, cloud)


def _record(q: AmclParameters, resolution_m: float, origin_xy_m: Sequence[float], laser_xyt: Pose) -> NDArray[np.void]:
    """What localization reads of the closed loop's parameters; the scanner's range comes with each scan."""
    if not (math.isfinite(resolution_m) and resolution_m > 0.0):
        raise ValueError(f"resolution_m must be greater than 0, got {resolution_m!r}")
    p = np.zeros(1, dtype=_PARAMETERS)
    p["amcl"], p["resolution"] = record_of(q), resolution_m
    p["origin_x"], p["origin_y"] = origin_xy_m
    p["mount_x"], p["mount_y"], _ = _pose_of(laser_xyt, "laser_xyt")
    return p


def _parameters_of(given: dict[str, Any]) -> AmclParameters:
    known = AmclParameters.model_fields.keys()
    if unknown := sorted(given.keys() - known):
        raise ValueError(f"AMCL has no modeled parameter {unknown[0]!r}; one of {', '.join(sorted(known))}")
    try:
        return AmclParameters(**given)
    except ValidationError as error:
        name, right = next(complaints(AmclParameters, error))
        raise ValueError(f"{name}: expected {right}, got {given[name]!r}" if name else right) from None


def _table(
    walls: NDArray[np.bool_], resolution_m: float, q: AmclParameters, range_max_m: float, *, double: bool
) -> NDArray[Any]:
    if not range_max_m > 0.0:
        raise ValueError(f"range_max_m must be greater than 0, got {range_max_m!r}")
    return _known_table(walls.tobytes(), walls.shape, resolution_m, q, usable_range_m(q, 0.0, range_max_m)[1], double)


@functools.lru_cache(maxsize=4)
def _known_table(
    walls: bytes, shape: tuple[int, int], resolution_m: float, q: AmclParameters, range_max_m: float, double: bool
) -> NDArray[Any]:
    """One table a map, which takes far longer to make than a pose to weigh; nobody writes to it."""
    return likelihood_cubed(
        np.frombuffer(walls, dtype=np.bool_).reshape(shape),
        resolution_m,
        range_max_m=range_max_m,
        z_hit=q.z_hit,
        z_rand=q.z_rand,
        sigma_hit_m=q.sigma_hit,
        likelihood_max_dist_m=q.laser_likelihood_max_dist,
        dtype=np.float64 if double else np.float32,
    )


def _directions(
    beams: int, angle_min_rad: float, angle_increment_rad: float, laser_yaw_rad: float
) -> NDArray[np.float64]:
    """(beams, 2) unit vectors of the beams in the robot's frame."""
    bearings_rad = laser_yaw_rad + angle_min_rad + angle_increment_rad * np.arange(beams)
    return np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad)])


def _ranges_of(ranges_m: ArrayLike) -> NDArray[np.float64]:
    ranges = np.ascontiguousarray(ranges_m, dtype=np.float64)
    if ranges.ndim != 1:
        raise ValueError(f"ranges_m must have one axis, the beams; its shape is {ranges.shape}")
    return ranges


def _walls_of(occupied: ArrayLike) -> NDArray[np.bool_]:
    walls = np.ascontiguousarray(occupied, dtype=np.bool_)
    if walls.ndim != 2 or walls.size == 0:
        raise ValueError(f"occupied must have rows and columns; its shape is {walls.shape}")
    return walls


def _pose_of(xyt: Pose, name: str) -> tuple[float, float, float]:
    if len(xyt) != 3 or not all(math.isfinite(value) for value in xyt):
        raise ValueError(f"{name} must be x, y (m) and yaw (rad), got {xyt!r}")
    return float(xyt[0]), float(xyt[1]), float(xyt[2])
