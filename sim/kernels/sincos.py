"""Sine and cosine as polynomials, so that loops over many angles are vectorized.

libm takes angles one by one (tens of ns each), and its last bits differ from host to host.
"""

from typing import Final

from vastflow.sim.kernels.numeric import inner

# π in two parts, the first short enough to be multiplied by any number of half turns without rounding.
_PI_HIGH: Final = 3.1415926218032837
_PI_LOW: Final = 3.178650954705639e-08
_PER_HALF_TURN: Final = 0.3183098861837907
_ROUND: Final = 6755399441055744.0
"""1.5 · 2⁵²: adding it and taking it away rounds to a whole number, with no instruction beyond SSE2's."""


@inner
def rounded(number: float) -> float:
    """The nearest whole number, for numbers below 2⁵¹."""
    return (number + _ROUND) - _ROUND


@inner
def sincos(angle_rad: float) -> tuple[float, float]:
    """Sine and cosine, to 1e-12 for angles below a thousand turns.

    Both are even or odd polynomials of the angle's distance to the nearest multiple of π, fitted to the least
    greatest error; odd multiples change the sign of both.
    """
    halves = rounded(angle_rad * _PER_HALF_TURN)
    rest = (angle_rad - halves * _PI_HIGH) - halves * _PI_LOW
    odd = halves - 2.0 * rounded(0.5 * halves)
    sign = 1.0 - 2.0 * odd * odd
    u = rest * rest
    sine = 1.5411323138825186e-10
    sine = sine * u - 2.503027785453994e-08
    sine = sine * u + 2.7556953247065895e-06
    sine = sine * u - 0.00019841266688447285
    sine = sine * u + 0.008333333320397079
    sine = sine * u - 0.1666666666646776
    sine = sine * u + 0.999999999999951
    cosine = 1.990764974818129e-09
    cosine = cosine * u - 2.752468223479428e-07
    cosine = cosine * u + 2.4801040288432914e-05
    cosine = cosine * u - 0.0013888884175821644
    cosine = cosine * u + 0.041666666473168856
    cosine = cosine * u - 0.499999999970202
    cosine = cosine * u + 0.9999999999992513
    return sign * rest * sine, sign * cosine
