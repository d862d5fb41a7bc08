"""Movers: bodies that move by a rule of time, or react, whatever they meet."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, Self, TypeAlias

import numpy as np
from pydantic import ValidationInfo, field_validator

from vastflow.sim.model.parameter import ParameterGroup
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.plug_ins.registry import Registry

Place: TypeAlias = tuple[float, float, float]
"""x, y (m), and yaw (rad) in the map's frame."""


class MoverRule(ParameterGroup):
    """Base of both kinds of movers: parameters are fields, see `parameter`; lists in them become tuples."""

    @field_validator("*", mode="before")
    @classmethod
    def _in_tuples(cls, value: Any, info: ValidationInfo) -> Any:
        return _frozen(value)

    def drawn(self, rng: np.random.Generator) -> Self:
        """Return the rule for one run, in which what is random has been drawn; by default nothing is.

        Args:
            rng: The body's own generator of that run.
        """
        return self


class Mover(MoverRule):
    """Base of bodies that move by a rule of time."""

    def pose_at(self, t_s: float) -> Place:
        """Return the pose at a time of the run, from 0 on; it depends on nothing else."""
        raise NotImplementedError


class Sight(NamedTuple):
    """The view of a body that reacts.

    Attributes:
        own: Its own pose.
        robot: The robot's true pose.
    """

    t_s: float
    own: Place
    robot: Place


class ReactiveMover(MoverRule):
    """Base of bodies that react to what they see."""

    def begin(self) -> Place:
        """Return the pose at the start of a run."""
        raise NotImplementedError

    def step(self, sight: Sight, dt_s: float) -> Place:
        """Return the pose `dt_s` later; it depends on nothing else."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class MovingBody:
    """A body of a world that moves.

    Attributes:
        rule: Rule of its motion; nothing in the world stops it.
    """

    name: str
    shape: Disc | Box
    rule: MoverRule


_STREAM: Final = 0x30FE
"""Separates what is drawn of movers from the random numbers of the robot's subsystems."""


def drawn_movers(movers: Sequence[MovingBody], entropy: Sequence[int]) -> tuple[MovingBody, ...]:
    """Return movers as they are in the run of this entropy, see `vastflow.sim.kernels.streams.run_entropy`."""
    seeds = (np.random.SeedSequence([*entropy, _STREAM, k]) for k in range(len(movers)))
    generators = (np.random.Generator(np.random.PCG64(seed)) for seed in seeds)
    return tuple(replace(body, rule=body.rule.drawn(rng)) for body, rng in zip(movers, generators, strict=True))


MOVER_PLUG_INS: Final = Registry("vastflow.movers", "mover", MoverRule, "campaign file")


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
