"""Conformance checks of movers, for authors' tests."""

import math
import pickle
from collections.abc import Callable
from typing import Final

from vastflow.sim.model.rates import TICK_S
from vastflow.sim.plug_ins.conformance import must, watched_generators
from vastflow.sim.world.mover import Mover, Place

FASTEST_MPS: Final = 100.0
_TICKS: Final = 2400


def check_mover(mover: Mover) -> None:
    """Run all `CHECKS` on a mover; raise an `AssertionError` otherwise."""
    for check in CHECKS:
        check(mover)


def check_poses(mover: Mover) -> None:
    """Check that it gives finite poses, and goes from one to the next."""
    before: Place | None = None
    for tick in range(_TICKS):
        place = mover.pose_at(tick * TICK_S)
        must(len(place) == 3 and all(map(math.isfinite, place)), _said(mover, f"give x, y, and yaw, got {place}"))
        steps_m = 0.0 if before is None else math.dist(place[:2], before[:2])
        must(steps_m <= FASTEST_MPS * TICK_S, _said(mover, f"not jump, got {steps_m:.3g} m at {tick * TICK_S:g} s"))
        before = place


def check_rule(mover: Mover) -> None:
    """Check that a pose depends on parameters and time alone: of a copy, too, in another order."""
    times_s = [tick * TICK_S for tick in range(0, _TICKS, 7)]
    with watched_generators() as used:
        poses = [mover.pose_at(t_s) for t_s in times_s]
        must(not used(), _said(mover, "not use a global random generator"))
    copy: Mover = pickle.loads(pickle.dumps(mover))
    again = [copy.pose_at(t_s) for t_s in reversed(times_s)][::-1]
    must(poses == again, _said(mover, "give equal poses at equal times"))


CHECKS: Final[tuple[Callable[[Mover], None], ...]] = (check_poses, check_rule)


def _said(mover: Mover, what: str) -> str:
    return f"{type(mover).__name__} must {what}"
