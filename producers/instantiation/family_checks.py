"""Faults of a family that are known before production, in its flow of keys and its constraints."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.campaign_file.scenario import AbstractScenario
from vastflow.producers.campaign_file.scenario_values import LOOPS_KEY, intended, replaced_by, unread_keys
from vastflow.producers.constraints.constraint import Checker
from vastflow.producers.constraints.quantities import QUANTITIES
from vastflow.producers.designs.space import DesignSpace, TooLarge
from vastflow.producers.instantiation.instantiate import Family, contradictions
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.faults import NOT_EXECUTED, Location, shown
from vastflow.producers.model.producer import Producer, draws_of, may_list_obstacles
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension
from vastflow.sim.system.keys import RECORDING_KEY, SUT
from vastflow.sim.world.environment import MAP_KEY, WORLD_KEY

MISSION_KEYS: Final = frozenset({START_KEY, GOAL_KEY, GOALS_KEY, LOOPS_KEY})


@dataclass(frozen=True, slots=True)
class Link:
    """A producer in the chain and its location in the file."""

    location: Location
    producer: Producer[Any]


@dataclass(frozen=True, slots=True)
class DataFlow:
    """The keys of a family: fixed parameters with their places, and the producers' keys."""

    document: Document
    location: Location
    fixed: Mapping[str, Location]
    links: Sequence[Link]

    @property
    def written(self) -> set[str]:
        """Every key that a configuration of this family may have."""
        return {*self.fixed, *(key for link in self.links for key in link.producer.writes)}

    def faults(self) -> Iterator[Fault]:
        """Keys that a producer needs and references that nothing writes."""
        available = set(self.fixed)
        for k, link in enumerate(self.links):
            for key in link.producer.needs:
                if key not in available and not key.startswith("_"):  # provenance is declared nowhere
                    yield self._needed(k, key)
            available |= set(link.producer.writes)
            yield from self._references(link.location, available | set(link.producer.needs))

    def mission_faults(self, abstract: AbstractScenario, *, needs_map: bool = True) -> Iterator[Fault]:
        """Keys that the abstract scenario needs and nothing writes.

        Args:
            needs_map: Whether the robot drives on a map, and not in a world alone.
        """
        written = self.written
        if WORLD_KEY in written and not needs_map:
            written = {*written, MAP_KEY}
        if abstract.goal_keys(written):
            written = {*written, GOAL_KEY}
        missing = list(dict.fromkeys(" or ".join(group) for group in abstract.needed if written.isdisjoint(group)))
        name = abstract.name or "a navigation mission"
        if MAP_KEY in missing and WORLD_KEY in written:
            missing.remove(MAP_KEY)
            unknown = f"{name} needs a map to localize on, and this world is not known to the robot"
            right = f"name what it knows as {MAP_KEY}, or drive a robot that needs no map"
            fixed = self.fixed.get(WORLD_KEY)
            where = fixed or next(link.location for link in self.links if WORLD_KEY in link.producer.writes)
            yield self.document.fault(where, unknown, right, at="key")
        if not missing:
            return
        misnamed = [
            (link, key) for link in self.links for key, tag in link.producer.writes.items()
            if tag == "task" and key not in MISSION_KEYS and key not in abstract.parameters
        ]  # fmt: skip
        if len(missing) == 1 and missing[0] != MAP_KEY and misnamed:
            link, key = misnamed[-1]
            unread = f"it writes {key!r}, which no mission reads"
            needed = f"{name} needs {missing[0]}"
            yield self.document.fault(self._mention(link, key), unread, needed)
        else:
            what = f"{name} needs {', '.join(missing)}, which nothing writes"
            right = "add a fixed parameter, or a producer that writes it"
            where = self.document.known((*self.location, "name"))
            yield self.document.fault(where, what, right, at="key" if where == self.location else "value")

    def _mention(self, link: Link, key: str) -> Location:
        """Return the place where a producer's parameters name the key, or else the producer's."""
        given = self.document.value(link.location)
        for name, value in given.items() if isinstance(given, dict) else ():
            if isinstance(value, str) and value.removeprefix("@") == key:
                return (*link.location, name)
        return link.location

    def _needed(self, k: int, key: str) -> Fault:
        link = self.links[k]
        later = [other for other in self.links[k + 1 :] if key in other.producer.writes]
        right = (
            f"put {later[0].location[-1]} before {link.location[-1]}"
            if later
            else f"add {key} to the family's parameters, or a producer before this one that writes it"
        )
        what = f"{link.location[-1]} needs {key!r}, which nothing before it writes"
        where = self._mention(link, key)
        return self.document.fault(where, what, right, at="key" if where == link.location else "value")

    def _references(self, location: Location, available: set[str]) -> Iterator[Fault]:
        value = self.document.value(location)
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, item in items:
            if isinstance(item, str) and item.startswith("@") and item[1:] not in available:
                what = f"{shown(item)} refers to a parameter that nothing before writes"
                yield self.document.fault((*location, key), what, did_you_mean(item[1:], available))
            yield from self._references((*location, key), available)


MOST_LOOKED_AT: Final = 20_000
"""Combinations of values; more are left to instantiation."""


def constraint_faults(family: Family, *, refuse_empty: bool = True) -> list[Fault]:
    """Constraints on plain values that can't be evaluated for some of them, or that leave nothing between them.

    Producers that read or build something are not asked, and constraints that name anything else are left out.
    """
    others = [producer for producer in family.producers if producer.reads or "environment" in producer.writes.values()]
    constraints = [
        c
        for c in family.constraints
        if not any(name.text in QUANTITIES or name.text.startswith("_") for name in c.expression.names)
        and not any(map(c.touched_by, others))
    ]
    touched = [producer for producer in family.producers if any(c.touched_by(producer) for c in constraints)]
    if not constraints:
        return []
    checker = Checker(family.name)
    space = DesignSpace(family.name, family.values, family.dimensions, touched, constraints, checker, MOST_LOOKED_AT)
    try:
        for producer in touched:
            space.join({digest: _first(producer, inputs) for digest, inputs in space.inputs().items()})
        blocks = space.blocks()
        checker.raise_faults()
    except TooLarge:
        return []
    except FileError as error:
        return list(error.faults)
    nothing = not all(len(block.table) for block in blocks) or (not blocks and bool(space.excluded))
    return contradictions(constraints, family.name, space.excluded) if nothing and refuse_empty else []


def _first(producer: Producer[Any], inputs: Mapping[str, Value]) -> list[Fragment | Rejection]:
    """Return what a producer yields; raises `TooLarge` for more than `MOST_LOOKED_AT` items."""
    items = list(itertools.islice(producer.produce(inputs, draws_of(producer, inputs)), MOST_LOOKED_AT + 1))
    if len(items) > MOST_LOOKED_AT:
        raise TooLarge(type(producer).__name__)
    return items


def unread(
    document: Document,
    flow: DataFlow,
    tags: Mapping[str, Dimension],
    system: Mapping[str, Value],
    abstract: AbstractScenario,
    *,
    whole: bool,
) -> Iterator[Fault]:
    """Yield faults and notes on keys that nothing reads; without the `whole` chain, only of those that are misspelled."""
    places, links = flow.fixed, flow.links
    read = {key for link in links for key in link.producer.reads}
    read |= {RECORDING_KEY, *abstract.parameters, *abstract.goal_keys(flow.written)}
    varied: dict[str, Location] = {}
    for link in links:
        for key, tag in link.producer.writes.items():
            if (tag or DIMENSION_OF_KEY.get(key, "system")) == "system":
                varied.setdefault(key, link.location)
    untold = {k for link in links for k, tag in link.producer.writes.items() if may_list_obstacles(k, tag)}
    written = {**varied, **{key: places[key] for key, tag in tags.items() if tag == "system"}}
    for key in unread_keys(system, varied):
        if key in read or key.startswith(SUT):
            continue
        if why := replaced_by(key, system, varied):
            yield document.note("warning", written[key], f"{key!r} has no effect", why)
            continue
        near = None if key in untold else intended(key, system, varied, read)
        if near and near not in flow.written:
            yield document.fault(written[key], f"unknown key {key!r}", f"did you mean {near!r}?", "key")
            continue
        what = f"unknown key {key!r} is ignored{', unless it lists obstacles' if key in untold else ''}"
        if whole:
            yield document.note("unknown key", written[key], what)
    if "mesh_file" in places:
        where, consequence = places["mesh_file"], "the map alone is the world"
        yield document.note("not executed", where, NOT_EXECUTED, consequence)
