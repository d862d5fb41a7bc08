"""A floor plan as what it says: spaces, features and openings in their own frames, in meters and radians."""

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from vastflow.sim.model.faults import Fault
from vastflow.sim.model.files import TextPlace

Point: TypeAlias = tuple[float, float]
Outline: TypeAlias = tuple[Point, ...]
"""Corners in order, the last joined to the first."""

FeatureKind: TypeAlias = Literal["Column", "Divider"]
OpeningKind: TypeAlias = Literal["Entryway", "Window"]


@dataclass(frozen=True, slots=True)
class PlanFrame:
    """The world's frame, a space's, or that of one of its walls.

    Attributes:
        space: None for the world.
        wall: None for the space's own frame.
    """

    space: str | None
    wall: int | None
    place: TextPlace = field(compare=False)

    def __str__(self) -> str:
        if self.space is None:
            return "world"
        return self.space if self.wall is None else f"{self.space}.walls[{self.wall}]"


@dataclass(frozen=True, slots=True)
class Offset:
    """A translation and a turn about z, measured in a frame."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class PlanSpace:
    """A room: its floor, and a wall along each edge.

    Attributes:
        outline: Of the floor, in the space's frame.
        thickness_m: Of its walls, measured from the floor's edge to the left of the direction of travel, which is
            outwards where the corners are listed clockwise.
        wrt: The frame it is placed in.
        of_wall: The wall of its own that `offset` places; None where it places the space's frame.
        spaced: Leave room for the thickness of both walls.
        aligned: Turn the two walls face to face.
    """

    name: str
    outline: Outline
    thickness_m: float
    height_m: float
    wrt: PlanFrame
    of_wall: int | None
    offset: Offset
    spaced: bool
    aligned: bool
    place: TextPlace = field(compare=False)


@dataclass(frozen=True, slots=True)
class Feature:
    """A column or divider, solid from the floor to its height.

    Attributes:
        space: The space it is declared in; None where it stands outside of all.
    """

    kind: FeatureKind
    name: str
    space: str | None
    outline: Outline
    height_m: float
    wrt: PlanFrame
    offset: Offset
    place: TextPlace = field(compare=False)


@dataclass(frozen=True, slots=True)
class Opening:
    """A hole through one wall or two.

    Attributes:
        outline: (x, z) in the frame of the first of `walls`: x along the wall from its middle, z up from the floor.
    """

    kind: OpeningKind
    name: str
    walls: tuple[PlanFrame, ...]
    outline: Outline
    place: TextPlace = field(compare=False)


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A floor plan that is right as far as its words go.

    Attributes:
        file: Its name for messages.
        notes: What its author should know of it.
    """

    name: str
    file: str
    spaces: tuple[PlanSpace, ...]
    features: tuple[Feature, ...]
    openings: tuple[Opening, ...]
    notes: tuple[Fault, ...] = ()
