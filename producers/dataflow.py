"""The flow of keys through a family: what is needed and what was written before, without producing anything."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vastflow.producers.abstract_scenario import AbstractScenario
from vastflow.producers.faults import Fault, Location, shown
from vastflow.producers.places.ground import MAP_KEY
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.producers.producer import Producer
from vastflow.producers.scenario_values import LOOPS_KEY
from vastflow.producers.vast.document import Document
from vastflow.sim.model.names import did_you_mean

MISSION_KEYS: Final = frozenset({START_KEY, GOAL_KEY, GOALS_KEY, LOOPS_KEY})


@dataclass(frozen=True, slots=True)
class Link:
    """A producer in the chain and where it stands."""

    location: Location
    producer: Producer[Any]


@dataclass(frozen=True, slots=True)
class DataFlow:
    """A family's keys.

    Attributes:
        location: Of the family.
        fixed: Key to the location of each fixed parameter.
        links: The producers in order.
    """

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

    def mission_faults(self, abstract: AbstractScenario) -> Iterator[Fault]:
        """Keys that the abstract scenario needs and nothing writes."""
        written = self.written
        if abstract.goal_keys(written):
            written = {*written, GOAL_KEY}
        missing = list(dict.fromkeys(" or ".join(group) for group in abstract.needed if written.isdisjoint(group)))
        if not missing:
            return
        name = abstract.name or "a navigation mission"
        misnamed = [
            (link, key) for link in self.links for key, tag in link.producer.writes.items()
            if tag == "task" and key not in MISSION_KEYS and key not in abstract.parameters
        ]  # fmt: skip
        if len(missing) == 1 and missing[0] != MAP_KEY and misnamed:
            link, key = misnamed[-1]
            unread = f"writes {key!r}, which no mission reads"
            needed = f"{missing[0]}, which {name} needs"
            yield self.document.fault(self._mention(link, key), unread, needed)
        else:
            what = f"{name} needs {', '.join(missing)}, which nothing writes"
            right = "a fixed parameter, or a producer that writes it"
            where = self.document.known((*self.location, "name"))
            yield self.document.fault(where, what, right, at="key" if where == self.location else "value")

    def _mention(self, link: Link, key: str) -> Location:
        """Where a producer's parameters name the key, or else the producer."""
        given = self.document.value(link.location)
        for name, value in given.items() if isinstance(given, dict) else ():
            if isinstance(value, str) and value.removeprefix("@") == key:
                return (*link.location, name)
        return link.location

    def _needed(self, k: int, key: str) -> Fault:
        link = self.links[k]
        later = [other for other in self.links[k + 1 :] if key in other.producer.writes]
        right = (
            f"{later[0].location[-1]} before {link.location[-1]}"
            if later
            else f"{key} among the family's parameters, or a producer before this one that writes it"
        )
        what = f"needs {key!r}, which nothing before it writes"
        where = self._mention(link, key)
        return self.document.fault(where, what, right, at="key" if where == link.location else "value")

    def _references(self, location: Location, available: set[str]) -> Iterator[Fault]:
        value = self.document.value(location)
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, item in items:
            if isinstance(item, str) and item.startswith("@") and item[1:] not in available:
                what = f"found {shown(item)}, a reference to a parameter that nothing before writes"
                yield self.document.fault((*location, key), what, did_you_mean(item[1:], available))
            yield from self._references((*location, key), available)
