"""From a scan to the transform map → odom: AMCL's update cycle."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.streams import AMCL
from vastflow.sim.nav2.amcl.particles import (
    Cloud,
    covariance,
    gate,
    heaviest_cluster,
    move,
    move_omni,
    resample,
    spread,
)
from vastflow.sim.nav2.amcl.sensor import normalize, weigh
from vastflow.sim.world.motion import wrapped


@inner
def localize(p: Any, m: Any, cubed: Any, cloud: Cloud) -> None:
    """One scan, `m.ranges`, through the filter."""
    update(p, m, m.ranges[: m.beams], m.directions[: m.beams], cubed, cloud)


@inner
def update(p: Any, m: Any, ranges_m: Any, directions: Any, cubed: Any, cloud: Cloud) -> None:
    """Update the filter with one scan taken at the odometry `m.scan_odom_…`, if the robot has moved enough.

    At the first scan the particles are drawn round the initial pose (`m.x`, `m.y`, `m.yaw`), with
    `p.initial_covariance` (4,) of xx, xy, yy and yaw, and weighted where they are. `m.localized` is 1 after an update
    that gave a pose; its covariance is in `m.pose_xx`, `m.pose_xy`, `m.pose_yy` and `m.pose_aa`. For the scan see `weigh`.
    """
    q, stream, first = p.amcl, m.streams[AMCL], m.first_scan == 1
    if first:
        m.first_scan, m.filter_updates, m.particles = 0, 0, q.max_particles
        spread(cloud, m.particles, stream, m.x, m.y, m.yaw, p.initial_covariance)
    else:
        dx, dy = m.scan_odom_x - m.filter_odom_x, m.scan_odom_y - m.filter_odom_y
        dyaw = wrapped(m.scan_odom_yaw - m.filter_odom_yaw)
        if not gate(dx, dy, dyaw, q):
            return
        if q.omni != 0:
            move_omni(cloud, m.particles, stream, dx, dy, m.filter_odom_yaw, dyaw, q)
        else:
            move(cloud, m.particles, stream, dx, dy, m.filter_odom_yaw, dyaw, q)
    m.filter_odom_x, m.filter_odom_y, m.filter_odom_yaw = m.scan_odom_x, m.scan_odom_y, m.scan_odom_yaw
    weigh(p, m.particles, ranges_m, directions, cubed, cloud)
    m.filter_updates += 1
    x, y, yaw = m.x, m.y, m.yaw
    if m.filter_updates % q.resample_interval == 0:
        m.particles, m.bins = resample(cloud, m.particles, stream, q)
        x, y, yaw = heaviest_cluster(cloud, m.bins)
        m.pose_xx, m.pose_xy, m.pose_yy, m.pose_aa = covariance(cloud.sums, m.bins)
    else:
        normalize(cloud.weights, m.particles)
        if not first:
            return
        initial = p.initial_covariance
        # The first pose is published in any case: that of the particles as they were drawn.
        m.pose_xx, m.pose_xy, m.pose_yy, m.pose_aa = initial[0], initial[1], initial[2], initial[3]
    m.map_odom_yaw = yaw - m.scan_odom_yaw
    c, s = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    m.map_odom_x = x - (c * m.scan_odom_x - s * m.scan_odom_y)
    m.map_odom_y = y - (s * m.scan_odom_x + c * m.scan_odom_y)
    m.localized = 1


@inner
def estimate(m: Any) -> None:
    """The robot's own idea of its pose: transform map → odom applied to odometry."""
    c, s = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    m.x = m.map_odom_x + c * m.odom_x - s * m.odom_y
    m.y = m.map_odom_y + s * m.odom_x + c * m.odom_y
    m.yaw = wrapped(m.map_odom_yaw + m.odom_yaw)
