"""Bags of a robot that wanders in a raster world, with other kinds of noise than `real_bags`."""

from dataclasses import dataclass

import numpy as np
from real_bags import Driven, Recorder, integrated
from scipy import ndimage

WIDTH_M, HEIGHT_M = 9.0, 7.0
FINE_M = 0.01
"""Cell of the world, so that its round obstacles are round."""


def world():
    """Return occupied cells (rows from below, columns) of a room with an oblique wall, columns, and an ellipse."""
    y, x = (np.indices((round(HEIGHT_M / FINE_M), round(WIDTH_M / FINE_M))) + 0.5) * FINE_M
    near = np.minimum.reduce([x, WIDTH_M - x, y, HEIGHT_M - y])
    occupied = (near < 0.1) | (x + 0.6 * y > 11.2) | (((x - 4.5) / 0.9) ** 2 + ((y - 6.2) / 0.5) ** 2 < 1.0)
    for cx, cy, radius in ((0.6, 0.8, 0.45), (8.3, 1.0, 0.5), (4.6, 0.4, 0.4), (0.4, 5.0, 0.6), (2.4, 6.6, 0.3)):
        occupied |= np.hypot(x - cx, y - cy) < radius
    return occupied


def sphere_traced(far_m, x, y, bearings):
    """Distances (B,) to occupied cells by steps of the distance to the nearest of them (m)."""
    gone_m = np.zeros(len(bearings))
    for _ in range(200):
        rows = ((y + gone_m * np.sin(bearings)) / FINE_M).astype(int).clip(0, far_m.shape[0] - 1)
        columns = ((x + gone_m * np.cos(bearings)) / FINE_M).astype(int).clip(0, far_m.shape[1] - 1)
        near_m = far_m[rows, columns]
        gone_m += np.where(near_m > 0.0, np.maximum(near_m - FINE_M, 0.25 * FINE_M), 0.0)
    return gone_m


@dataclass
class RasterRecorder(Recorder):
    """A recorder whose beams meet the cells of the world."""

    def __post_init__(self):
        self.far_m = ndimage.distance_transform_edt(~world()) * FINE_M

    def ranges_from(self, x, y, bearings):
        return sphere_traced(self.far_m, x, y, bearings)


def wandering(seed, *, dead_s=0.0, lag_s=0.0, slip=0.0, legs=14):
    """Wander in arcs, lines, and turns between (2.5, 2) and (6.5, 5); arguments as for `real_bags.driven`.

    Steps of odometry are off by uniform variables, one each 0.05 s.
    """
    rng = np.random.default_rng(seed)
    step_s, pose, parts = 0.01, np.array([3.5, 2.5, 0.0]), [np.zeros((80, 2))]
    for _ in range(legs):
        aim = np.array([rng.uniform(2.5, 6.5), rng.uniform(2.0, 5.0)]) - pose[:2]
        turn = float(np.angle(np.exp(1j * (np.arctan2(aim[1], aim[0]) - pose[2]))))
        turn_rate, speed = rng.uniform(0.4, 1.0), rng.uniform(0.2, 0.5)
        way_m = float(np.hypot(*aim))
        spin = np.tile([0.0, np.copysign(turn_rate, turn)], (round(abs(turn) / turn_rate / step_s), 1))
        go = np.tile([speed, 0.0], (round(way_m / speed / step_s), 1))
        go[len(go) // 2 :, 1] = rng.choice([0.0, 0.0, rng.uniform(-0.15, 0.15)])  # a line, or one that bends
        new = [spin, np.zeros((round(rng.uniform(40, 160)), 2)), go, np.zeros((round(rng.uniform(40, 160)), 2))]
        parts += new
        pose = integrated(np.concatenate(new) * step_s, pose)[-1]
    command = np.concatenate(parts)
    command = command[np.arange(len(command)) // 5 * 5]
    delayed = np.vstack([np.zeros((round(dead_s / step_s), 2)), command])[: len(command)]
    motion, gain = np.zeros_like(command), 1.0 if lag_s == 0 else 1 - np.exp(-step_s / lag_s)
    for k in range(1, len(command)):
        motion[k] = motion[k - 1] + gain * (delayed[k - 1] - motion[k - 1])
    gone = motion * step_s
    counted = gone.copy()
    for k in range(0, len(gone), 5):
        # A uniform variable of half-width √3 has the variance 1.
        counted[k] += rng.uniform(-1, 1, 2) * slip * np.sqrt(3 * np.abs(gone[k : k + 5]).sum(axis=0))
    start = np.array([3.5, 2.5, 0.0])
    return Driven(
        np.arange(len(command)) * step_s, command, motion, integrated(gone, start), integrated(counted, np.zeros(3))
    )
