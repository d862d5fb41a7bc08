"""Elementary functions with one bit pattern on every host: those of C libraries and NumPy differ in their last bits.

They take + - * / and square roots alone, which IEEE 754 defines to the last bit, in a sequence that no compiler changes without leave.
Kernels have them under the names of `math` (see `vastflow.sim.kernels.numba_target`); elsewhere they are imported from here.
Polynomials are fitted to the least greatest relative error. Errors are in units of the last place (ulp), measured against mpmath.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# π/2 and ln 2 in parts, the first of them short enough to be multiplied by whole numbers without rounding.
_HALF_PI: Final = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_LN_2: Final = (0.6931471803691238, 1.9082149292705877e-10)
_ROUND: Final = 6755399441055744.0
"""1.5 · 2⁵²: adding it and taking it away rounds to a whole number."""
_PI_LOW: Final = 1.2246467991473532e-16
"""π less the double nearest to it."""
_TAIL: Final = 3.6541528853610088
"""Magnitude beyond which NumPy draws a normal number from the tail, by a logarithm of the C library."""


def cos_sin(angle_rad: float) -> tuple[float, float]:
    """Return cosine and sine of a finite angle, to 1.3 ulp up to 10⁶ rad.

    Beyond, they are those of its rest by the double nearest to 2π.
    """
    rest, below, turn = angle_rad, 0.0, 0.0
    if abs(angle_rad) > 0.785:
        if abs(angle_rad) > 1e6:
            angle_rad = angle_rad - math.tau * ((angle_rad * 0.15915494309189535 + _ROUND) - _ROUND)
        quarters = (angle_rad * 0.6366197723675814 + _ROUND) - _ROUND
        far, near = angle_rad - quarters * _HALF_PI[0], quarters * _HALF_PI[1]
        rest = far - near
        back = rest - far
        below = ((far - (rest - back)) - (near + back)) - quarters * _HALF_PI[2]
        turn = quarters - 4.0 * ((0.25 * quarters + _ROUND) - _ROUND)
    u = rest * rest
    s = -2.5050758114914726e-08 + u * 1.589679563029495e-10
    s = 0.008333333333322413 + u * (-0.00019841269829807805 + u * (2.755731369191626e-06 + u * s))
    sine = rest - ((u * (0.5 * below - rest * u * s) - below) - rest * u * -0.16666666666666632)
    c = -2.7557314352334104e-07 + u * (2.087572327340276e-09 + u * -1.1359647811801192e-11)
    c = 0.0416666666666666 + u * (-0.0013888888888874125 + u * (2.4801587289482188e-05 + u * c))
    half = 0.5 * u
    most = 1.0 - half
    cosine = most + (((1.0 - most) - half) + (u * (u * c) - rest * below))
    # Odd quarter turns exchange the two; the signs of both follow from the quarters modulo 4, here -2 to 2.
    is_odd = turn * turn == 1.0
    cosine, sine = (sine, cosine) if is_odd else (cosine, sine)
    return (-cosine if turn > 0.0 or turn < -1.0 else cosine), (-sine if turn < 0.0 or turn > 1.0 else sine)


def sin(angle_rad: float) -> float:
    """Sine, as `cos_sin`."""
    return cos_sin(angle_rad)[1]


def cos(angle_rad: float) -> float:
    """Cosine, as `cos_sin`."""
    return cos_sin(angle_rad)[0]


def tan(angle_rad: float) -> float:
    """Tangent, to 2.5 ulp, as `cos_sin`."""
    cosine, sine = cos_sin(angle_rad)
    return sine / cosine


def atan2(y: float, x: float) -> float:
    """Angle of a finite vector from the x axis, to 1.5 ulp."""
    across, along = abs(y), abs(x)
    toward = math.copysign(1.0, x)
    if min(across, along) > 0.41421356237309503 * max(across, along):
        base, t = (2.0 - toward) * (0.25 * math.pi), toward * ((across - along) / (across + along))
    elif across > along:
        base, t = 0.5 * math.pi, -toward * (along / across)
    else:
        base, t = (0.0 if toward > 0.0 else math.pi), (toward * (across / along) if along > 0.0 else 0.0)
    u = t * t
    a = -0.050397423511497855 + u * (0.03807564308717128 + u * -0.017919287932990313)
    a = 0.0769206138096379 + u * (-0.06663117388040565 + u * (0.05847986550587661 + u * a))
    a = -0.14285714280239548 + u * (0.11111110785670232 + u * (-0.09090897822502338 + u * a))
    a = -0.333333333333332 + u * (0.19999999999953996 + u * a)
    low = base * (_PI_LOW / math.pi)
    return math.copysign(base + (t + (t * u * a + low)), y)


def asin(sine: float) -> float:
    """Angle in [-π/2, π/2] of a sine in [-1, 1], to 2.5 ulp."""
    return atan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))


def acos(cosine: float) -> float:
    """Angle in [0, π] of a cosine in [-1, 1], to 2.5 ulp."""
    return atan2(math.sqrt((1.0 - cosine) * (1.0 + cosine)), cosine)


def exp(x: float) -> float:
    """e to the power of x, to 1 ulp; infinite above 709.78."""
    if not -745.2 < x < 709.782712893384:
        return math.inf if x > 0.0 else max(x, 0.0)
    power = (x * 1.4426950408889634 + _ROUND) - _ROUND
    high, low = x - power * _LN_2[0], power * _LN_2[1]
    rest = high - low
    u = rest * rest
    p = 6.613756250548583e-05 + u * (-1.6533837541349343e-06 + u * 4.136059532433049e-08)
    c = rest - u * (0.16666666666666555 + u * (-0.0027777777776698265 + u * p))
    return math.ldexp(1.0 + (high - (low - rest * c / (2.0 - c))), int(power))


def log(x: float) -> float:
    """Natural logarithm, to 1 ulp; -∞ of 0, NaN of what is negative."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else x if x > 0.0 else math.nan
    fraction, power = math.frexp(x)
    if fraction < 0.7071067811865476:
        fraction, power = 2.0 * fraction, power - 1
    f = fraction - 1.0
    s = f / (2.0 + f)
    u = s * s
    r = 0.22222198553439532 + u * (0.18183565423377487 + u * (0.15314020741681988 + u * 0.14796264660766914))
    r = u * (0.6666666666666734 + u * (0.39999999999413943 + u * (0.2857142874256601 + u * r)))
    half = 0.5 * f * f
    return power * _LN_2[0] - ((half - (s * (half + r) + power * _LN_2[1])) - f)


def hypot(x: float, y: float) -> float:
    """Length of a vector, to 1.2 ulp where its square is neither infinite nor below 10⁻³⁰⁰."""
    return math.sqrt(x * x + y * y)


def dist(one: Sequence[float], other: Sequence[float]) -> float:
    """Distance of two points of as many coordinates."""
    square = 0.0
    for a, b in zip(one, other, strict=True):
        square += (a - b) * (a - b)
    return math.sqrt(square)


def hypots(x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float64]:
    """`hypot` of arrays."""
    return np.asarray(np.sqrt(x * x + y * y))


def atan2s(y: NDArray[Any], x: NDArray[Any]) -> NDArray[np.float64]:
    """`atan2` of arrays (N,)."""
    return np.array([atan2(*point) for point in zip(y.tolist(), x.tolist(), strict=True)])


def normals(rng: np.random.Generator, shape: tuple[int, ...], kind: type[np.floating[Any]]) -> NDArray[Any]:
    """Draw as `rng.standard_normal` does, with logarithms of ours in the distribution's tail.

    Where NumPy rejects a number by an exponential of the C library, the last bit decides once in 10¹⁰ numbers or less.
    """
    before = rng.bit_generator.state
    drawn = rng.standard_normal(shape, dtype=kind)
    flat, begin = drawn.reshape(-1), 0
    tails = np.flatnonzero(np.abs(flat) > kind(_TAIL)).tolist()
    bits = np.uint32 if kind is np.float32 else np.uint64
    most = np.iinfo(bits).max
    if tails:
        rng.bit_generator.state = before
    for at in tails:
        rng.standard_normal(at - begin, dtype=kind)
        while rng.integers(most, dtype=bits, endpoint=True) & 0xFF:  # another layer than the lowest, and rejected
            rng.random(dtype=kind)
        while True:
            beyond = kind(log(1.0 - float(rng.random(dtype=kind)))) * -kind(1.0 / _TAIL)
            if -2.0 * log(1.0 - float(rng.random(dtype=kind))) > beyond * beyond:
                break
        flat[at], begin = np.copysign(kind(_TAIL) + beyond, flat[at]), at + 1
    if tails:
        rng.standard_normal(flat.size - begin, dtype=kind)
    return drawn
