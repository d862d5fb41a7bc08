"""A floor plan: its spaces, features, and openings, in meters and radians."""

from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

from vastflow.producers.floorplan.geometry import Outline, Transform
from vastflow.sim.model.faults import Fault
from vastflow.sim.model.files import TextPlace

WORLD: Final = "world"

FeatureKind: TypeAlias = Literal["Column", "Divider"]
OpeningKind: TypeAlias = Literal["Entryway", "Window"]


@dataclass(frozen=True, slots=True)
class PlanFrame:
    """The frame of the world if `space` is None, else of the space or one of its walls."""

    space: str | None
    wall: int | None
    place: TextPlace = field(compare=False)

    def __str__(self) -> str:
        if self.space is None:
            return WORLD
        return self.space if self.wall is None else f"{self.space}.walls[{self.wall}]"


@dataclass(frozen=True, slots=True)
class PlanSpace:
    """A room: its floor, and a wall along each edge.

    Attributes:
        outline: Outline of the floor, in the space's frame.
        thickness_m: Thickness of its walls, measured from the floor's edge to the left of the direction of travel, which is
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
    offset: Transform
    spaced: bool
    aligned: bool
    place: TextPlace


@dataclass(frozen=True, slots=True)
class Feature:
    """A column or divider, declared in `space` or, where that is None, outside of all."""

    kind: FeatureKind
    name: str
    space: str | None
    outline: Outline
    height_m: float
    wrt: PlanFrame
    offset: Transform


@dataclass(frozen=True, slots=True)
class Opening:
    """A hole through one wall or two: `outline` is (x, z) in the frame of the first, as in `building.Hole`."""

    kind: OpeningKind
    name: str
    walls: tuple[PlanFrame, ...]
    outline: Outline
    place: TextPlace


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A floor plan that is syntactically valid."""

    name: str
    file: str
    spaces: tuple[PlanSpace, ...]
    features: tuple[Feature, ...]
    openings: tuple[Opening, ...]
    notes: tuple[Fault, ...]
