"""The producers of environments: floor plans as they are written, and with drawn dimensions."""

import functools
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Self, TypeAlias, TypeVar

from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from vastflow.producers.floorplan.environment import keep_environment
from vastflow.producers.floorplan.files import PlanFile, VariationFile, read_plan_file, read_variation_file
from vastflow.producers.floorplan.grid import LASER_HEIGHT_M, RESOLUTION_M, grid_of
from vastflow.producers.floorplan.variation import GREATEST_SEED
from vastflow.producers.model import producer
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.faults import MISSING_FILE
from vastflow.producers.model.numbers import Count, NotNegative, Positive, Seed
from vastflow.producers.model.producer import Draws, Producer
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError, Invalid
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.world.environment import MAP_KEY

MESH_KEY = "mesh_file"
FLOORPLAN_KEY = "_floorplan"

F = TypeVar("F", PlanFile, VariationFile)


def _some(value: Any) -> Any:
    # A least length of the field would complain a second time of a list whose files are wrong.
    if isinstance(value, list | tuple) and not value:
        raise ValueError("expected the path of at least one file, got an empty list")
    return value


def _read(read: Callable[[Path], F], kind: type[F]) -> Callable[[Any, ValidationInfo], F]:
    """Build a validator that resolves a path against the context's `base` and checks the file.

    Files that were read are kept in the context's `plans`.
    """

    def validate(value: Any, info: ValidationInfo) -> F:
        if isinstance(value, kind):
            return value
        if type(value) is not str:
            raise ValueError(f"expected the path of a file, got {value!r}")
        context = info.context or {}
        known = context.get("plans", {})  # a file may be named a hundred times, and reading it builds its plan
        if (kind, value) not in known:
            try:
                read_file = read(Path(context.get("base", "."), value))
                _ = read_file.building() if isinstance(read_file, PlanFile) else read_file.variation()
            except FileError as error:
                code = MISSING_FILE if all(fault.kind == "missing" for fault in error.faults) else "floorplan"
                raise PydanticCustomError(code, "{error}", {"error": error.brief}) from None
            known[kind, value] = read_file
        found: F = known[kind, value]
        return found.called(value)  # where the campaign lies is no part of what it says

    return validate


_SERIALIZED: Final = PlainSerializer(lambda file: file.name, return_type=str)
_TEXT: Final = WithJsonSchema({"type": "string"})

Plan: TypeAlias = Annotated[PlanFile, PlainValidator(_read(read_plan_file, PlanFile)), _SERIALIZED, _TEXT]
"""The path of a `.fpm` file, relative to the campaign file; its text once read."""

VariedPlan: TypeAlias = Annotated[
    VariationFile, PlainValidator(_read(read_variation_file, VariationFile)), _SERIALIZED, _TEXT
]
"""The path of a `.variation` file, relative to the campaign file; its text and its plan's once read."""


class EnvironmentParameters(producer.Parameters):
    """Parameters of both producers."""

    name: Annotated[tuple[str, ...], Field(min_length=2, max_length=2)] = (MAP_KEY, MESH_KEY)
    """Keys of the map and of the mesh."""
    resolution: Positive = RESOLUTION_M
    """Edge of a cell of the map (m)."""
    laser_height: NotNegative = LASER_HEIGHT_M
    """Height of the slice through the building that is the map (m)."""

    @model_validator(mode="after")
    def _check_name(self) -> Self:
        if len(set(self.keys)) < 2 or not all(self.keys):
            raise ValueError(f"name: expected two names, got {list(self.name)!r}")
        return self

    @property
    def keys(self) -> tuple[str, str]:
        """Return both keys without an optional leading `@`."""
        map_key, mesh_key = (key.removeprefix("@") for key in self.name)
        return map_key, mesh_key


E = TypeVar("E", bound=EnvironmentParameters)


class EnvironmentProducer(Producer[E]):
    """Base of both: what depends on nothing and writes a map and a mesh."""

    reads = ()

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        return dict.fromkeys(self.parameters.keys, self.parameters.dimension or "environment")

    def _made(self, plan: PlanFile, requested: Mapping[str, Value]) -> Fragment | Rejection:
        """The environment of a plan, `requested` saying which it is; a rejection where it can't be built."""
        try:
            building = plan.building()
            grid = grid_of(building, self.parameters.resolution, self.parameters.laser_height)
        except FileError as error:
            return Rejection(error.brief, requested)
        map_key, mesh_key = self.parameters.keys
        map_file, mesh_file = keep_environment(building, grid, plan.text, requested)
        return Fragment({map_key: map_file, mesh_key: mesh_file, FLOORPLAN_KEY: {"plan": building.name, **requested}})


@functools.lru_cache(maxsize=16)  # hundreds of families may name one plan, and each notes it
def _plan_notes(plan: PlanFile) -> tuple[Fault, ...]:
    return tuple(plan.building().notes)


MOST_LOOKED_AT: Final = 50
"""Maximum number of one variation's plans that are checked when a campaign is read; 75 rooms take 20 ms a plan."""
_NUMBER: Final = re.compile(r"-?\d+(\.\d+)?(e[-+]\d+)?")


@functools.lru_cache(maxsize=16)
def _drawn_notes(file: VariationFile, seeds: range) -> tuple[Fault, ...]:
    """Note each kind that drawn plans have and the written one has not, with the first plan's seed and numbers.

    The place is that in the plan as it is written. Plans that can't be built have no notes.
    """
    variation, said = file.variation(), {_kind(note) for note in _plan_notes(file.plan)}
    found: dict[tuple[int, int, str, str], list[tuple[int, Fault]]] = {}
    looked_at, noted = seeds[:MOST_LOOKED_AT], list[Fault]()
    for seed in looked_at:
        with suppress(FileError):
            notes = variation.building(variation.sample(seed)).notes
            for kind, note in {_kind(note): note for note in notes if _kind(note) not in said}.items():
                found.setdefault(kind, []).append((seed, note))
    for (seed, note), *others in found.values():
        several = f" and in {len(others)} more of the first {len(looked_at)} variations" if others else ""
        noted.append(replace(note, problem=f"as drawn with seed {seed}{several}, {note.problem}", kind="drawn"))
    return tuple(noted)


def _kind(note: Fault) -> tuple[int, int, str, str]:
    return note.place.line, note.place.column, note.place.where, _NUMBER.sub("#", str(note.problem))


class FloorplanGenerationParameters(EnvironmentParameters):
    """Parameters of `FloorplanGeneration`."""

    floorplans: Annotated[tuple[Plan, ...], BeforeValidator(_some)]
    """FloorPlan DSL files (`.fpm`), relative to the campaign file."""


class FloorplanGeneration(EnvironmentProducer[FloorplanGenerationParameters]):
    """Floor plans as they are written: an environment each, in their order."""

    Parameters = FloorplanGenerationParameters

    @property
    def notes(self) -> tuple[Fault, ...]:
        return tuple(note for plan in dict.fromkeys(self.parameters.floorplans) for note in _plan_notes(plan))

    @property
    def most_choices(self) -> int:
        return len(self.parameters.floorplans)

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield each plan's environment; draws nothing."""
        for plan in self.parameters.floorplans:
            yield self._made(plan, {"file": plan.name})


class FloorplanVariationParameters(EnvironmentParameters):
    """Parameters of `FloorplanVariation`."""

    variation_files: Annotated[tuple[VariedPlan, ...], BeforeValidator(_some)]
    """Variation DSL files (`.variation`), relative to the campaign file."""
    num_variations: Count = 1
    """Buildings drawn from each file."""
    seed: Seed = 0
    """Seed of the first building of each file; the next ones have the next numbers."""

    @model_validator(mode="after")
    def _check_seed(self) -> Self:
        last = self.seed + self.num_variations - 1
        if last > GREATEST_SEED:
            raise Invalid(f"the last seed is {last}", f"the greatest is {GREATEST_SEED}")
        return self


class FloorplanVariation(EnvironmentProducer[FloorplanVariationParameters]):
    """Floor plans with drawn dimensions: `num_variations` environments from each file.

    Variation k has the seed `seed` + k and is drawn from numpy's `RandomState` as the Variation DSL documents it, not
    from the generator that other producers draw from: the same file and seed give the same numbers in other tools.
    """

    Parameters = FloorplanVariationParameters

    @property
    def notes(self) -> tuple[Fault, ...]:
        """Notes of the varied plans, as written and as drawn."""
        seeds = range(self.parameters.seed, self.parameters.seed + self.parameters.num_variations)
        files = dict.fromkeys(self.parameters.variation_files)
        written = [note for plan in dict.fromkeys(file.plan for file in files) for note in _plan_notes(plan)]
        return (*written, *(note for file in files for note in _drawn_notes(file, seeds)))

    @property
    def most_choices(self) -> int:
        return self.parameters.num_variations * len(self.parameters.variation_files)

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield each variation's environment, or a rejection if its numbers make no valid building."""
        for file in self.parameters.variation_files:
            variation = file.variation()
            for k in range(self.parameters.num_variations):
                sample = variation.sample(self.parameters.seed + k)
                requested: dict[str, Value] = {"file": file.name, "seed": sample.seed, "drawn": dict(sample.values)}
                yield self._made(PlanFile(f"{file.plan.name} with seed {sample.seed}", sample.text), requested)
