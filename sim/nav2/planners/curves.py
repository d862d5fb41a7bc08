"""Shortest curves of bounded curvature: Dubins (forward only) and Reeds–Shepp (with reversing).

Lengths are in turning radii, headings in radians. A curve is (length, word, mirrored, lengths): up to five arcs and lines, whose
kinds `WORDS` has, left and right exchanged in a mirrored one; a negative length is driven in reverse.

After Dubins (1957) and Reeds and Shepp (1990), whose section 8 has the formulas.
"""

import math
from typing import Any, Final

import numpy as np

from vastflow.sim.kernels.numeric import inner, njit

NOTHING, LEFT, STRAIGHT, RIGHT = range(4)

LSL, LSR, LRL, LRLR, LRSL, LRSR, LSRL, RSRL, LRSLR = range(9)
WORDS: Final = np.array(
    [
        (LEFT, STRAIGHT, LEFT, NOTHING, NOTHING),
        (LEFT, STRAIGHT, RIGHT, NOTHING, NOTHING),
        (LEFT, RIGHT, LEFT, NOTHING, NOTHING),
        (LEFT, RIGHT, LEFT, RIGHT, NOTHING),
        (LEFT, RIGHT, STRAIGHT, LEFT, NOTHING),
        (LEFT, RIGHT, STRAIGHT, RIGHT, NOTHING),
        (LEFT, STRAIGHT, RIGHT, LEFT, NOTHING),
        (RIGHT, STRAIGHT, RIGHT, LEFT, NOTHING),
        (LEFT, RIGHT, STRAIGHT, LEFT, RIGHT),
    ],
    dtype=np.int64,
)

_ZERO: Final = 1e-9
_QUARTER: Final = 0.5 * math.pi
_NONE: Final = (math.inf, 0, (0.0, 0.0, 0.0, 0.0, 0.0))
"""No curve of a word: (length, word, lengths)."""


@njit
def shortest(x: float, y: float, heading_rad: float, reverses: bool) -> Any:
    """The shortest curve from the origin, along x, to a pose."""
    best, mirrored = _NONE, False
    for mirror in range(2):
        side, turn = (-y, -heading_rad) if mirror == 1 else (y, heading_rad)
        if reverses:
            length, word, (a, b, c, d, e) = _forward_words(-x, side, -turn)
            found = _shorter(_forward_words(x, side, turn), (length, word, (-a, -b, -c, -d, -e)))
        else:
            found = _dubins(x, side, turn)
        if found[0] < best[0]:
            best, mirrored = found, mirror == 1
    return best[0], best[1], mirrored, best[2]


@njit
def pose_on(curve: Any, along: float) -> Any:
    """(x, y, heading, reversing) at a distance from the beginning of a curve."""
    _, word, mirrored, lengths = curve
    x, y, heading, left, backward = 0.0, 0.0, 0.0, along, False
    for k in range(5):
        part = min(abs(lengths[k]), left)
        left -= part
        kind = WORDS[word, k]
        if kind == NOTHING or part == 0.0:
            continue
        backward = lengths[k] < 0.0
        by = -part if backward else part
        if kind == STRAIGHT:
            x, y = x + by * math.cos(heading), y + by * math.sin(heading)
            continue
        bend = 1.0 if (kind == LEFT) != mirrored else -1.0
        turned = heading + bend * by
        x += bend * (math.sin(turned) - math.sin(heading))
        y -= bend * (math.cos(turned) - math.cos(heading))
        heading = turned
    return x, y, heading, backward


@inner
def _within(angle_rad: float) -> float:
    """An angle in [-π, π)."""
    return angle_rad - 2.0 * math.pi * math.floor((angle_rad + math.pi) / (2.0 * math.pi))


@inner
def _positive(angle_rad: float) -> float:
    """Normalize an angle to [0, 2π); values just below 0 become 0."""
    angle = angle_rad - 2.0 * math.pi * math.floor(angle_rad / (2.0 * math.pi))
    return 0.0 if 2.0 * math.pi - angle < _ZERO else angle


@inner
def _shorter(one: Any, other: Any) -> Any:
    return one if one[0] <= other[0] else other


@inner
def _curve(word: int, a: float, b: float, c: float, d: float, e: float) -> Any:
    return abs(a) + abs(b) + abs(c) + abs(d) + abs(e), word, (a, b, c, d, e)


@inner
def _dubins(x: float, y: float, phi: float) -> Any:
    """The shortest Dubins curve that begins to the left."""
    best = _NONE
    # Centers of the left circles, and of the left and the right one.
    u_x, u_y = x - math.sin(phi), y - 1.0 + math.cos(phi)
    u, angle = math.hypot(u_x, u_y), math.atan2(u_y, u_x)
    t = _positive(angle)
    best = _shorter(best, _curve(LSL, t, u, _positive(phi - t), 0.0, 0.0))
    if u <= 4.0:
        # The middle circle lies on either side; its arc of less than half a circle is never on a shortest curve.
        bend = math.acos(0.25 * u)
        t = _positive(angle + _QUARTER + bend)
        p = math.pi + 2.0 * bend
        best = _shorter(best, _curve(LRL, t, p, _positive(phi - t + p), 0.0, 0.0))
    v_x, v_y = x + math.sin(phi), y - 1.0 - math.cos(phi)
    square = v_x * v_x + v_y * v_y
    if square >= 4.0:
        line = math.sqrt(square - 4.0)
        t = _positive(math.atan2(v_y, v_x) + math.atan2(2.0, line))
        best = _shorter(best, _curve(LSR, t, line, _positive(t - phi), 0.0, 0.0))
    return best


@inner
def _forward_words(x: float, y: float, phi: float) -> Any:
    """The shortest Reeds–Shepp curve that begins forward and to the left, or its reverse."""
    best = _shorter(_lsl(x, y, phi), _lsr(x, y, phi))
    best = _shorter(best, _four_arcs(x, y, phi))
    best = _shorter(best, _five_parts(x, y, phi))
    back_x, back_y = x * math.cos(phi) + y * math.sin(phi), x * math.sin(phi) - y * math.cos(phi)
    best = _shorter(best, _three_arcs(x, y, phi, False))
    best = _shorter(best, _three_arcs(back_x, back_y, phi, True))
    best = _shorter(best, _arcs_and_line(x, y, phi, False))
    return _shorter(best, _arcs_and_line(back_x, back_y, phi, True))


@inner
def _lsl(x: float, y: float, phi: float) -> Any:
    """8.1: L+ S+ L+."""
    u_x, u_y = x - math.sin(phi), y - 1.0 + math.cos(phi)
    t = math.atan2(u_y, u_x)
    v = _within(phi - t)
    return _curve(LSL, t, math.hypot(u_x, u_y), v, 0.0, 0.0) if t >= -_ZERO and v >= -_ZERO else _NONE


@inner
def _lsr(x: float, y: float, phi: float) -> Any:
    """8.2: L+ S+ R+."""
    u_x, u_y = x + math.sin(phi), y - 1.0 - math.cos(phi)
    square = u_x * u_x + u_y * u_y
    if square < 4.0:
        return _NONE
    u = math.sqrt(square - 4.0)
    t = _within(math.atan2(u_y, u_x) + math.atan2(2.0, u))
    v = _within(t - phi)
    return _curve(LSR, t, u, v, 0.0, 0.0) if t >= -_ZERO and v >= -_ZERO else _NONE


@inner
def _three_arcs(x: float, y: float, phi: float, back: bool) -> Any:
    """8.3 and 8.4: L+ R- L-, or the same from its end."""
    u_x, u_y = x - math.sin(phi), y - 1.0 + math.cos(phi)
    reach = math.hypot(u_x, u_y)
    if reach > 4.0:
        return _NONE
    u = -2.0 * math.asin(0.25 * reach)
    t = _within(math.atan2(u_y, u_x) + 0.5 * u + math.pi)
    v = _within(phi - t + u)
    if t < -_ZERO or u > _ZERO:
        return _NONE
    return _curve(LRL, v, u, t, 0.0, 0.0) if back else _curve(LRL, t, u, v, 0.0, 0.0)


@inner
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> Any:
    delta = _within(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    angle = math.atan2(eta * a - xi * b, xi * a + eta * b)
    flipped = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0
    tau = _within(angle + math.pi) if flipped else _within(angle)
    return tau, _within(tau - u + v - phi)


@inner
def _four_arcs(x: float, y: float, phi: float) -> Any:
    """8.7 and 8.8: L+ R+ L- R-, and L+ R- L- R+, the middle arcs equally long."""
    best = _NONE
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    rho = 0.25 * (2.0 + math.hypot(xi, eta))
    if rho <= 1.0:
        u = math.acos(rho)
        t, v = _tau_omega(u, -u, xi, eta, phi)
        if t >= -_ZERO and v <= _ZERO:
            best = _curve(LRLR, t, u, -u, v, 0.0)
    rho = (20.0 - xi * xi - eta * eta) / 16.0
    if 0.0 <= rho <= 1.0:
        u = -math.acos(rho)
        t, v = _tau_omega(u, u, xi, eta, phi)
        if u >= -_QUARTER and t >= -_ZERO and v >= -_ZERO:
            best = _shorter(best, _curve(LRLR, t, u, u, v, 0.0))
    return best


@inner
def _arcs_and_line(x: float, y: float, phi: float, back: bool) -> Any:
    """8.9 and 8.10: L+ R-(π/2) S- L-, and L+ R-(π/2) S- R-, or the same from their ends."""
    best = _NONE
    xi, eta = x - math.sin(phi), y - 1.0 + math.cos(phi)
    rho = math.hypot(xi, eta)
    if rho >= 2.0:
        line = math.sqrt(rho * rho - 4.0)
        u = 2.0 - line
        t = _within(math.atan2(eta, xi) + math.atan2(line, -2.0))
        v = _within(phi - _QUARTER - t)
        if t >= -_ZERO and u <= _ZERO and v <= _ZERO:
            best = _curve(LSRL, v, u, -_QUARTER, t, 0.0) if back else _curve(LRSL, t, -_QUARTER, u, v, 0.0)
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    rho = math.hypot(xi, eta)
    if rho >= 2.0:
        t, u = math.atan2(xi, -eta), 2.0 - rho
        v = _within(t + _QUARTER - phi)
        if t >= -_ZERO and u <= _ZERO and v <= _ZERO:
            found = _curve(RSRL, v, u, -_QUARTER, t, 0.0) if back else _curve(LRSR, t, -_QUARTER, u, v, 0.0)
            best = _shorter(best, found)
    return best


@inner
def _five_parts(x: float, y: float, phi: float) -> Any:
    """8.11: L+ R-(π/2) S- L-(π/2) R+."""
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    rho = math.hypot(xi, eta)
    if rho < 2.0:
        return _NONE
    u = 4.0 - math.sqrt(rho * rho - 4.0)
    if u > _ZERO:
        return _NONE
    t = _within(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    v = _within(t - phi)
    return _curve(LRSLR, t, -_QUARTER, u, -_QUARTER, v) if t >= -_ZERO and v >= -_ZERO else _NONE
