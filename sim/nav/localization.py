"""From a scan to the transform map → odom: AMCL's update cycle."""

import math
from typing import Any

from vastflow.sim.nav import amcl
from vastflow.sim.nav.amcl import Cloud
from vastflow.sim.numeric import inner
from vastflow.sim.robot import wrapped
from vastflow.sim.streams import AMCL


@inner
def localize(p: Any, m: Any, cubed: Any, cloud: Cloud) -> None:
    """One scan through the filter: gated motion, weighting, resampling, and a new transform map → odom."""
    stream = m.streams[AMCL]
    dx, dy = m.odom_x - m.filter_odom_x, m.odom_y - m.filter_odom_y
    dyaw = wrapped(m.odom_yaw - m.filter_odom_yaw)
    if m.first_scan == 1:
        # The mission's initial pose has zero covariance (paper's study): every particle starts there.
        m.first_scan = 0
        m.particles = int(p.max_particles)
        for k in range(m.particles):
            cloud.particles[0, k], cloud.particles[1, k], cloud.particles[2, k] = m.x, m.y, m.yaw
    elif amcl.gate(dx, dy, dyaw, p.update_min_d, p.update_min_a):
        amcl.move(
            cloud.particles,
            m.particles,
            stream,
            dx,
            dy,
            m.filter_odom_yaw,
            dyaw,
            p.alpha1,
            p.alpha2,
            p.alpha3,
            p.alpha4,
        )
    else:
        return
    m.filter_odom_x, m.filter_odom_y, m.filter_odom_yaw = m.odom_x, m.odom_y, m.odom_yaw
    n_points = amcl.beam_points(
        m.ranges, int(p.max_beams), m.directions, p.mount_x, p.mount_y, p.range_min, p.range_max, m.points
    )
    amcl.weigh(cloud, m.particles, m.points, n_points, cubed, p.resolution, p.origin_x, p.origin_y)
    m.particles, m.bins = amcl.resample(
        cloud, m.particles, stream, int(p.min_particles), int(p.max_particles), p.pf_err, p.pf_z
    )
    x, y, yaw = amcl.heaviest_cluster(cloud, m.bins)
    m.map_odom_yaw = yaw - m.odom_yaw
    c, sn = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    m.map_odom_x = x - (c * m.odom_x - sn * m.odom_y)
    m.map_odom_y = y - (sn * m.odom_x + c * m.odom_y)
    m.localized = 1


@inner
def estimate(m: Any) -> None:
    """The robot's own idea of its pose: transform map → odom applied to odometry."""
    c, sn = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    m.x = m.map_odom_x + c * m.odom_x - sn * m.odom_y
    m.y = m.map_odom_y + sn * m.odom_x + c * m.odom_y
    m.yaw = wrapped(m.map_odom_yaw + m.odom_yaw)
