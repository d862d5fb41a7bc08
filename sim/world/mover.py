"""Movers: bodies that move by a rule of time, or react, whatever they meet."""

from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

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
    rule: Mover | ReactiveMover


MOVER_PLUG_INS: Final = Registry("vastflow.movers", "mover", MoverRule, "campaign file")


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
