"""One scenario family of a campaign file, read and checked."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from vastflow.producers.campaign_file.document import Document, faults_of
from vastflow.producers.campaign_file.scenario import WHERE, AbstractScenario
from vastflow.producers.campaign_file.scenario_values import (
    combined_complaint,
    complaint_of,
    dimension_of,
    mask_complaints,
)
from vastflow.producers.campaign_file.sections import CARTESIAN, Design, DesignSpec, robot_places
from vastflow.producers.campaign_file.spec import ExecutionSpec, FamilySpec, StartCheckKind, is_tolerated_in_family
from vastflow.producers.catalog.parameter import ParameterVariationList
from vastflow.producers.constraints.constraint import Constraint, read_constraints, unknown_names
from vastflow.producers.instantiation.family_checks import DataFlow, Link, constraint_faults, unread
from vastflow.producers.instantiation.instantiate import Family
from vastflow.producers.model.configuration import Fragment, Partial
from vastflow.producers.model.faults import Location, path_text, shown
from vastflow.producers.model.producer import (
    ROOM_KEY,
    Producer,
    check_declared,
    draws_of,
    find_producer,
)
from vastflow.producers.places.ground import GROUND, MAP_FILE_KEYS, MapSearch
from vastflow.producers.places.start_check import is_beyond, pose_complaints, room_m, stops_of
from vastflow.producers.places.stops import GOALS_KEY
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Complaint, Fault, FileError, Got, Place, Problem
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.recording import recording_value
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension, ProcessSetup
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import plug_in_value
from vastflow.sim.reading.abstract import hall_file
from vastflow.sim.reading.movers import MOVERS_KEY, movers_value
from vastflow.sim.scenario.programs.config_files import complaint as config_complaint
from vastflow.sim.system.keys import RECORDING_KEY, SUT, is_of_footprint
from vastflow.sim.system.robot import NOISE_MODEL_KEY, ROBOT_KEY
from vastflow.sim.system.system import system_of
from vastflow.sim.world.environment import MAP_KEY, WORLD_KEY, world_files
from vastflow.sim.world.readers.actors import actor_names
from vastflow.sim.world.readers.own import world_value
from vastflow.sim.world.readers.reader import MissingWorld
from vastflow.sim.world.world import free_unknown_cells, read_world

OVERRIDES: Final[Location] = ("execution", "local", "parameter_overrides")

MAX_CHECKED_VALUES: Final = 10_000
"""Values of one producer that are looked at in advance."""

_DESIGN: Final[TypeAdapter[DesignSpec]] = TypeAdapter(Design)


class FamilyReader:
    """Reads the families of one file and collects faults and notes.

    Attributes:
        faults: Everything wrong, but for that.
        unavailable: Faults of each family that lacks nothing but files or goals.
    """

    def __init__(
        self,
        document: Document,
        base: Path,
        abstract: AbstractScenario | None,
        system: Mapping[str, Value] | None = None,
        maps: MapSearch | None = None,
        max_configurations: int = ExecutionSpec().max_configurations,
        *,
        programs: ProcessSetup | None = None,
        refuse_empty: bool = True,
    ) -> None:
        """Read families of `document`; file names are relative to `base`.

        Args:
            abstract: The abstract scenario of every family; None where it could not be read.
            system: Values of the system dimension that every family has.
            maps: Search for maps; None to look below `base`.
            max_configurations: Greatest number of configurations of each family.
            programs: Setup of the programs, with their configuration files.
            refuse_empty: Whether constraints that leave nothing of a family are a fault.
        """
        self.faults: list[Fault] = []
        self.unavailable: dict[str, list[Fault]] = {}
        self.notes: list[Fault] = []
        self._document = document
        self._base = base
        self._abstract = abstract
        self._system = system or {}
        self._max_configurations = max_configurations
        self._programs = programs
        self._refuse_empty = refuse_empty
        self._search = maps or MapSearch(base)
        self._context: dict[str, Any] = {"base": base, "maps": self._search, "plans": {}}
        self._remarked: set[str] = set()
        self._maps: dict[str, FileContent] = {}
        self._overridden, self._overrides = self._fixed(OVERRIDES)
        if abstract is not None:
            for key in self._overridden.keys() - abstract.parameters:
                what = f"{key!r} is not a parameter of {abstract.name or 'a navigation mission'}"
                right = did_you_mean(key, abstract.parameters, "name a scenario_file that has it")
                self._fault(self._overridden[key], what, right, at="key")

    def read(self, location: Location, name: str, dimensions: Mapping[str, Dimension]) -> Family:
        """The valid parts of the family at `location`; the others become faults."""
        known_faults = len(self.faults)
        places, values = self._fixed((*location, "parameters"))
        robot, twice = robot_places(self._document, (*location, ROBOT_KEY), places)
        self.faults += twice
        places |= robot | self._overridden
        values |= {key: self._document.value(where) for key, where in robot.items()}
        if NOISE_MODEL_KEY in robot:
            values[NOISE_MODEL_KEY] = plug_in_value(values[NOISE_MODEL_KEY], self._base)
        values |= self._overrides
        tags = {key: dimension_of(key, value, dimensions.get(key)) for key, value in values.items()}
        for key in set(dimensions) - set(places):
            where = (*location, "dimensions", key)
            self._fault(where, f"{key!r} is not a fixed parameter of this family", did_you_mean(key, places), at="key")
        system = {**self._system, **{key: value for key, value in values.items() if tags[key] == "system"}}
        links, whole = self._chain((*location, "variations"), system, {*places})
        constraints = self._constraints(location)
        flow = DataFlow(self._document, location, places, links)
        good = self._check_fixed(flow, values, tags, system)
        if self._abstract:
            for found in unread(self._document, flow, tags, good, self._abstract, whole=whole):
                (self.faults if found.kind == "error" else self.notes).append(found)
        unknown = self._document.value(location).keys() - FamilySpec.model_fields.keys()
        if whole and all(map(is_tolerated_in_family, unknown)):  # what could not be read may write anything
            self._check_flow(flow, constraints, good)
        given = {key: tag for key, tag in tags.items() if tag != DIMENSION_OF_KEY.get(key, "system")}
        producers = tuple(link.producer for link in links)
        design = (*location, "design")
        place = Place(self._document.file, *self._document.place(design, "key"), path_text(design))
        left_open = self._left_open(self._abstract, flow) if self._abstract and whole else {}
        fixed = {**self._system, **left_open, **values}
        start_check: StartCheckKind = (
            "none" if self._document.value((*location, "start_check")) == "none" else "footprint"
        )
        if start_check == "footprint" and any(ROOM_KEY in producer.reads for producer in producers):
            fixed[ROOM_KEY] = room_m(fixed, producers)
        family = Family(
            *(name, fixed, given, producers, tuple(constraints), self._design(design), place, self._max_configurations),
            overrides=self._overrides,
            start_check=start_check,
        )
        own = self.faults[known_faults:]
        if own and all(fault.kind == "missing" for fault in own):
            self.unavailable[name] = own
            del self.faults[known_faults:]
            return family
        if self._abstract and self._abstract.in_world and self._refuse_empty:
            self._check_poses(flow, Partial(name, values, tags), good, start_check)
        if not own:
            self._note_remarks(links)
            self.faults += constraint_faults(family, refuse_empty=self._refuse_empty)
        return family

    def _check_flow(self, flow: DataFlow, constraints: Sequence[Constraint], system: Mapping[str, Value]) -> None:
        self.faults += flow.faults()
        needs_map = True
        with suppress(FileError):  # said already
            needs_map = system_of(system).needs_map
        self.faults += flow.mission_faults(self._abstract, needs_map=needs_map) if self._abstract else ()
        for constraint in constraints:
            self.faults += unknown_names(self._document, constraint, {*self._system, *flow.written})

    def _check_poses(
        self, flow: DataFlow, fixed: Partial, system: Mapping[str, Value], start_check: StartCheckKind
    ) -> None:
        """Fixed poses that suit no configuration are faults, or warnings where the family asks for no start check.

        That is looked at where the map is fixed, too; path producers keep a given start and given goals.
        """
        drawn = [each.producer for each in flow.links]
        written = {key for producer in drawn for key in producer.writes if key not in producer.reads}
        key, file = next(iter(world_files(fixed.values).items()), ("", None))
        if file is None or any(key in producer.writes for producer in drawn):
            return
        kept = {key: value for key, value in fixed.values.items() if key not in written}
        world = read_world(file)
        known = stops_of(replace(fixed, values=kept))
        stops = {name: pose for name, pose in known if not is_beyond(world, name, pose)}
        radius_m = 0.0
        if not any(is_of_footprint(key) for producer in drawn for key in producer.writes):
            with suppress(FileError):  # said already
                driven = system_of(system)
                radius_m = min(driven.inscribed_radius_m, driven.robot.radius_m)
        for name, what, right in pose_complaints(world.ground, stops, radius_m) if stops else ():
            key, _, index = name.rstrip("]").partition("[")
            where = (*flow.fixed[key], *([int(index)] if index else []))
            if start_check == "none":
                self.notes.append(self._document.note("warning", where, what, right))
            else:
                self._fault(where, what, right)

    def _note_remarks(self, links: Sequence[Link]) -> None:
        for link in links:
            for remark in link.producer.remarks:
                if remark not in self._remarked:  # each once a file
                    self._remarked.add(remark)
                    self.notes.append(self._document.note("warning", link.location, remark))

    def _fault(self, location: Location, what: Problem, right: str, *, at: Any = "value") -> None:
        self.faults.append(self._document.fault(location, what, right, at))

    def _listed(self, location: Location) -> list[Any]:
        """The list at `location`; empty if the model has already reported another value there."""
        found = self._document.value(location)
        return found if isinstance(found, list) else []

    def _fixed(self, location: Location) -> tuple[dict[str, Location], dict[str, Value]]:
        places: dict[str, Location] = {}
        values: dict[str, Value] = {}
        entries = [entry if isinstance(entry, dict) else {} for entry in self._listed(location)]
        for k, key, value in [(k, *item) for k, entry in enumerate(entries) for item in entry.items()]:
            where = (*location, k, key)
            if key in places:
                line, _ = self._document.place(places[key], "key")
                self._fault(where, f"duplicate key {key!r}, given in line {line} already", "keep one of them", at="key")
                continue
            if key.startswith("_"):
                self._fault(where, Got(repr(key)), "a name without a leading underscore", at="key")
            places[key] = where
            if key in (WORLD_KEY, RECORDING_KEY):
                values[key] = self._read(where, value, world_value if key == WORLD_KEY else recording_value)
            elif key == MOVERS_KEY:
                values[key] = movers_value(value, self._base)
            elif key not in MAP_FILE_KEYS:
                values[key] = plug_in_value(value, self._base) if key == NOISE_MODEL_KEY else value
            elif content := self._map(where, value):
                values[key] = content
        own = values.get(WORLD_KEY)
        if isinstance(own, FileContent) and MOVERS_KEY not in values and (names := actor_names(Path(own.path))):
            what = f"the world's actors are no bodies: {', '.join(names)}"
            right = "they walk where the key movers has them, as init --worlds writes it"
            self.notes.append(self._document.note("warning", places[WORLD_KEY], what, right))
        return places, values

    def _map(self, location: Location, value: Any) -> FileContent | None:
        if not isinstance(value, str):
            self._fault(location, Got(shown(value)), "the path of a map_server YAML file")
            return None
        if value not in self._maps:
            try:
                self._maps[value] = found = self._search.content(value)
                if location[-1] == MAP_KEY and (n := free_unknown_cells(found)):
                    what = f"cells of the gray of unknown ones, 205, are free, as for map_server: {n:,}"
                    right = "with free_thresh: 0.196 they are unknown, and no path leads there"
                    self.notes.append(self._document.note("warning", location, what, right))
            except ValueError as error:  # WorldError; ValueError for a NUL in the path
                fault = self._document.fault(location, str(error))
                self.faults.append(replace(fault, kind="missing") if isinstance(error, MissingWorld) else fault)
        return self._maps.get(value)

    def _read(self, location: Location, value: Value, read: Callable[[Value, Path], Value]) -> Value:
        try:
            return read(value, self._base)
        except ValueError as error:  # ScenarioError; ValueError for a NUL in the path
            self.faults.append(self._document.fault(location, str(error).removeprefix(f"{WORLD_KEY}: ")))
        return value

    def _check_fixed(
        self,
        flow: DataFlow,
        values: Mapping[str, Value],
        tags: Mapping[str, Dimension],
        system: Mapping[str, Value],
    ) -> Mapping[str, Value]:
        """Report fixed values that are wrong, and return the system without them."""
        complaints = {key: self._complaint(key, value, tags[key], system) for key, value in values.items()}
        for key, complaint in complaints.items():
            if complaint:
                value = values[key]
                if isinstance(value, str) and value.startswith("@"):
                    nowhere = "" if value[1:] in flow.written else ", and nothing writes this parameter"
                    complaint = f"{shown(value)} is a reference{nowhere}", "only producers take references"
                fault = self._document.fault(flow.fixed[key], *complaint)
                self.faults.append(replace(fault, kind="missing") if key == GOALS_KEY and value == [] else fault)
        good = {key: value for key, value in system.items() if not complaints.get(key)}
        if found := combined_complaint(good):
            key, complaint = found
            section = ROBOT_KEY if key.startswith(f"{ROBOT_KEY}.") and key in flow.fixed else "parameters"
            self._fault((*flow.location, section), *complaint, at="key")
            good.pop(key, None)
        for _, complaint in mask_complaints(good, flow.written):
            self._fault((*flow.location, "parameters"), *complaint, at="key")
        return good

    def _complaint(self, key: str, value: Value, dimension: Dimension, system: Mapping[str, Value]) -> Complaint | None:
        """Return the simulator's complaint about a value, else the scenario's."""
        if key.startswith(SUT):
            return config_complaint(self._programs, key, value) if self._abstract else None
        said = complaint_of(key, value, dimension, system)
        return said or (self._abstract.complaint(key, value) if self._abstract else None)

    def _chain(self, location: Location, system: Mapping[str, Value], written: set[str]) -> tuple[list[Link], bool]:
        links: list[Link] = []
        raw = self._listed(location)
        for k, entry in enumerate(raw):
            if isinstance(entry, dict) and len(entry) == 1:
                ((name, given),) = entry.items()
                where = (*location, k, name)
                self._context[GROUND] = f"@{WORLD_KEY}" if WORLD_KEY in written and MAP_KEY not in written else None
                if producer := self._producer(where, name, given, system):
                    links.append(Link(where, producer))
                    written |= producer.writes.keys()
        return links, len(links) == len(raw)

    def _producer(self, location: Location, name: str, given: Any, system: Mapping[str, Value]) -> Producer[Any] | None:
        kind: type[Producer[Any]] | None = None
        try:
            kind = find_producer(name, self._base)
            if given is not None and not isinstance(given, dict):
                self._fault(location, Got(shown(given)), f"the parameters of {name} as a mapping")
                return None
            with plug_in_code():
                producer = kind(kind.Parameters.model_validate(given or {}, context=self._context))
                check_declared(producer)
                self._check_produced(location, producer, system)
                self.notes += producer.notes
        except PlugInError as error:
            self._fault(location, error.problem, error.expected, at="key")
        except Exception as error:  # noqa: BLE001 - whatever a user's file or class raises
            if kind is not None and isinstance(error, ValidationError):
                self.faults += faults_of(self._document, location, kind.Parameters, error)
            else:
                right = "a producer follows vastflow.producers.model.producer.Producer"
                self._fault(location, f"{name!r} raised {type(error).__name__}: {error}", right, at="key")
        else:
            return producer
        return None

    def _check_produced(self, location: Location, producer: Producer[Any], system: Mapping[str, Value]) -> None:
        """Look at the values of a producer that depends on nothing, such as a list of them."""
        writes = producer.writes  # asks each value of a list
        tags = (tag or DIMENSION_OF_KEY.get(key) for key, tag in writes.items())
        is_listed = isinstance(producer, ParameterVariationList)
        if producer.reads or ("environment" in tags and not is_listed):  # a floor plan is not built for a look
            return
        fragments = itertools.islice(producer.produce({}, draws_of(producer, {})), MAX_CHECKED_VALUES)
        reported: set[tuple[Location, str]] = set()
        for k, fragment in enumerate(fragments):
            for key, value in fragment.values.items() if isinstance(fragment, Fragment) else ():
                complaint = self._complaint(key, value, dimension_of(key, value, writes.get(key)), system)
                where = self._document.known((*location, "values", k))
                if complaint and (where, complaint[1]) not in reported:
                    reported.add((where, complaint[1]))
                    self._fault(where, *complaint)

    def _constraints(self, location: Location) -> list[Constraint]:
        """Return the constraints of the campaign and of the family, in this order."""
        constraints, faults = read_constraints(self._document, ("constraints",))
        own, own_faults = read_constraints(self._document, (*location, "constraints"))
        self.faults += [*faults, *own_faults]
        named = {constraint.name for constraint in constraints}
        self.faults += [
            Fault(constraint.place, f"the campaign has a constraint {constraint.name!r} already", "choose another name")
            for constraint in own
            if constraint.name in named
        ]
        return [*constraints, *own]

    def _design(self, location: Location) -> DesignSpec:
        """The design; the model has already reported an invalid one."""
        try:
            return _DESIGN.validate_python(self._document.value(location))
        except ValidationError:
            return CARTESIAN

    def _left_open(self, abstract: AbstractScenario, flow: DataFlow) -> dict[str, Value]:
        """Return defaults for required values that the family omits; each is noted once."""
        written = flow.written
        values: dict[str, Value] = {}
        if abstract.launches_own_map and MAP_KEY not in written and (hall := self._map(WHERE, str(hall_file()))):
            values[MAP_KEY] = hall
            self._say_of_scenario(
                "the scenario launches a simulation with a map of its own, which is not here",
                "the robot drives in a hall of ours, 60 m x 60 m with pillars, unless a family names a map_file",
            )
        if keys := abstract.goal_keys(written):
            given = keys[0] if len(keys) == 1 else f"{keys[0]} to {keys[-1]}"
            self._say_of_scenario(
                f"the scenario takes one goal_pose, and there are {given}", "the robot is sent to each of them in turn"
            )
        for name in abstract.optional_objects:
            if name not in written:
                self._say_of_scenario(f"the scenario takes {name}, which nothing writes", "it spawns none of them")
        return values

    def _say_of_scenario(self, what: Problem, right: str) -> None:
        note = self._document.note("warning", WHERE, what, right)
        if note not in self.notes:
            self.notes.append(note)
