"""The campaign: a `.vast` file, read, checked, its size and path lengths too, and ready to be instantiated."""

import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from vastflow.producers.campaign_file.document import Document, faults_of, read_document
from vastflow.producers.campaign_file.postprocessing import step_notes, steps_of
from vastflow.producers.campaign_file.robovast import EXPECTED, SCHEMAS
from vastflow.producers.campaign_file.scenario import CONTAINERS, FROM_GOAL, abstract_scenario_of, programs_of
from vastflow.producers.campaign_file.sections import Sequential
from vastflow.producers.campaign_file.spec import (
    DEFAULT_TIMEOUT_S,
    CampaignSpec,
    EvaluationSpec,
    ExecutionSpec,
    is_tolerated_in_family,
    unexecuted,
)
from vastflow.producers.campaign_file.visualization import visualization_notes
from vastflow.producers.catalog.path import UNPROVED, PathVariationRandom
from vastflow.producers.instantiation.family import FamilyReader
from vastflow.producers.instantiation.instantiate import Family
from vastflow.producers.model.configuration import Rejection
from vastflow.producers.model.faults import NOT_EXECUTED, Location, shown
from vastflow.producers.model.producer import evaluate
from vastflow.producers.places.ground import MapSearch
from vastflow.producers.search.reading import read_search, unknown_strategy
from vastflow.producers.search.search import Search
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Fault, FileError, Problem
from vastflow.sim.model.files import is_file
from vastflow.sim.model.nodes import Nodes
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.system.keys import FILE_KEY, RELEASE_KEY
from vastflow.sim.system.system import SystemFile, system_kind

__all__ = ["Campaign", "Family", "OracleRequest", "load_campaign", "oracle_requests"]


@dataclass(frozen=True, slots=True)
class OracleRequest:
    """An oracle that the file asks for, and the location of its parameters."""

    name: str
    parameters: Mapping[str, Any]
    location: Location


@dataclass(frozen=True)
class Campaign:
    """A campaign file that has no fault.

    Attributes:
        path: The file itself, absolute and without links: how it was named reaches nothing but messages.
        abstract: `builtin:…`, a scenario file, or empty where each family's mission follows from its goal.
        programs: Setup of a run's programs; None where the scenario starts none.
        runs: Repetitions of each configuration, at most.
        sequential: When they end before; None where each configuration has all of them.
        notes: Warnings, and keys that are not executed by this version; then what of the Nav2 parameter file is not
            modeled.
        nav2_defaults: What the Nav2 parameter file leaves out, see `defaults_row` of `findings`; None without a file.
        unavailable: Faults of each family that lacks files or goals; it is not among `families`.
        unexecutable: Why this version can't run the campaign; empty where it can.
        search: Search that proposes points, in place of families; `families` are then its template at corners of the space. None where
            the file has families, or can't be run.
        borrowed_maps: Path of each map that is not beside the file, to the name that the file has for it.
    """

    path: Path
    spec: CampaignSpec
    families: tuple[Family, ...]
    abstract: str | FileContent
    programs: ProcessSetup | None
    runs: int
    sequential: Sequential | None
    seed: int
    timeout_s: float
    oracles: tuple[OracleRequest, ...]
    notes: tuple[Fault, ...]
    nav2_defaults: Mapping[str, Value] | None
    unexecutable: tuple[Fault, ...]
    unavailable: Mapping[str, Sequence[Fault]]
    document: Document = field(repr=False)
    borrowed_maps: Mapping[str, str] = field(default_factory=dict)
    search: Search | None = field(default=None, repr=False)

    @property
    def nodes(self) -> Nodes | None:
        """The nodes that drive the robot; None where the built-in stack does."""
        return None if self.programs is None else self.programs.nodes

    @property
    def missing(self) -> tuple[Fault, ...]:
        """All files that are missing."""
        return tuple(fault for faults in self.unavailable.values() for fault in faults)

    def runs_asked(self, runs: int | None, sample: int | None = None) -> int:
        """Runs of each configuration: `runs`, or the file's where that is None.

        Args:
            sample: Greatest number of configurations that are run, where not all are.

        Raises:
            FileError: these are more than the file permits.
        """
        if runs is None:
            return self.runs
        configurations = min(sum(map(most_configurations, self.families)), sample or sys.maxsize)
        if faults := runs_faults(self.document, configurations, self.spec.execution, runs):
            raise FileError(faults)
        return runs

    def fault(self, location: Location, what: Problem, right: str = "", at: Literal["key", "value"] = "value") -> Fault:
        """A fault at a place of the file that was found elsewhere, such as in an oracle's parameters."""
        return self.document.fault(location, what, right, at)


def load_campaign(path: str | Path, map_dir: Path | None = None) -> Campaign:
    """Read a campaign file, with its producers' parameters and its maps.

    Maps and `file.py:Class` are relative to the file.

    Args:
        map_dir: Folder in which maps are looked for that are not beside the file, by the same relative path.

    Raises:
        FileError: every fault of the file.
    """
    document = read_document(path)
    if (version := document.value(("version",))) in SCHEMAS:
        raise FileError([document.fault(("version",), f"{version} is a schema of RoboVAST 2", EXPECTED)])
    path = Path(path).resolve()
    data, notes = _without_tolerated(document)
    faults: list[Fault] = []
    spec = CampaignSpec()
    try:
        spec = CampaignSpec.model_validate(data)
    except ValidationError as error:
        faults += faults_of(document, (), CampaignSpec, error)
        wrong = {detail["loc"][0] for detail in error.errors()}
        with suppress(ValidationError):
            spec = CampaignSpec.model_validate({key: part for key, part in data.items() if key not in wrong})
        if "search" in wrong and isinstance(strategy := document.value(("search", "strategy")), str):
            faults += unknown_strategy(document, strategy, Path(path).parent)
    abstract, abstract_faults = abstract_scenario_of(document, path.parent)
    programs, program_notes, program_faults = programs_of(document, path.parent, spec.execution, abstract or FROM_GOAL)
    faults += [*abstract_faults, *program_faults]
    system_file = system_file_of(document, path.parent)
    maps = MapSearch(path.parent, map_dir and map_dir.resolve())
    given = document, path.parent, abstract, system_file.values, maps, spec.execution.max_configurations
    reader = FamilyReader(*given, programs=programs)
    families = [family for family in _families(document, reader) if family.name not in reader.unavailable]
    searching = None
    if spec.search and not spec.configuration:
        searching = read_search(
            document,
            spec.search,
            spec.execution,
            path.parent,
            lambda filled: FamilyReader(filled, *given[1:], programs=programs, refuse_empty=False),
        )
        families, faults = [*searching.families], [*faults, *searching.faults]
    faults += [*reader.faults, *_family_set_faults(document), *_oracle_faults(document)]
    if faults or document.faults or system_file.faults or (reader.unavailable and not families):
        faults += [fault for missing in reader.unavailable.values() for fault in missing]
        # What could not be read stands as nothing in the data, so the model complains of it a second time.
        places = {(fault.place.line, fault.place.column) for fault in document.faults}
        own = [fault for fault in faults if (fault.place.line, fault.place.column) not in places]
        ignored = [note for note in (*notes, *reader.notes) if note.kind == "unknown key"]
        raise FileError([*document.faults, *own, *system_file.faults, *ignored])
    if too_many := size_faults(document, families, spec.execution):
        raise FileError(too_many)
    executed = CONTAINERS if programs and programs.containers and not spec.execution.containers else ()
    notes += [
        document.note("not executed", at, NOT_EXECUTED, why) for at, why in unexecuted(spec) if at not in executed
    ]
    notes += [*program_notes, *reader.notes]
    steps = steps_of(spec.results_processing.postprocessing)
    notes += step_notes(document, steps, path.parent, ("results_processing", "postprocessing"))
    notes += visualization_notes(document, spec.evaluation.visualization, path.parent)
    runs = spec.execution.runs
    return Campaign(
        path=path,
        spec=spec,
        families=tuple(families),
        abstract=(abstract or FROM_GOAL).content,
        programs=programs,
        runs=runs.max if isinstance(runs, Sequential) else runs,
        sequential=runs if isinstance(runs, Sequential) else None,
        seed=spec.execution.seed,
        timeout_s=spec.execution.timeout or DEFAULT_TIMEOUT_S,
        oracles=tuple(oracle_requests(spec.evaluation)),
        notes=(
            *sorted(dict.fromkeys([*document.notes, *notes]), key=lambda note: (note.place.line, note.place.column)),
            *system_file.notes,
        ),
        nav2_defaults=system_file.defaults,
        unexecutable=searching.unexecutable if searching else (),
        unavailable=reader.unavailable,
        document=document,
        borrowed_maps=maps.borrowed,
        search=searching.search if searching else None,
    )


def system_file_of(document: Document, base: Path) -> SystemFile:
    """Read the parameter file of a campaign file, which is relative to `base`."""
    release, where = document.value(("execution", RELEASE_KEY)), ("execution", FILE_KEY)
    if not isinstance(name := document.value(where), str):
        said = document.fault(("execution", RELEASE_KEY), "there is a release without a file", f"add {FILE_KEY}")
        return SystemFile(faults=(said,) if release else ())
    path = base / name
    if not is_file(path):
        return SystemFile(faults=(document.fault(where, f"there is no file {shown(name)}"),))
    return system_kind().read_file(path, {RELEASE_KEY: release})


def _without_tolerated(document: Document) -> tuple[dict[str, Any], list[Fault]]:
    """The file's data without the keys that version 1 read over, and a warning for each."""
    families = document.data.get("configuration")
    if not isinstance(families, list):
        return document.data, []
    notes: list[Fault] = []
    kept = [*families]
    for i, family in enumerate(families):
        tolerated = [key for key in family if is_tolerated_in_family(key)] if isinstance(family, dict) else []
        for key in tolerated:
            right = f"write 'execution.{key}', which is for all families" if key in ExecutionSpec.model_fields else ""
            kind: Literal["warning", "unknown key"] = "warning" if right else "unknown key"
            notes.append(document.note(kind, ("configuration", i, key), f"{key!r} has no effect in a family", right))
            kept[i] = {key: value for key, value in kept[i].items() if key not in tolerated}
    return {**document.data, "configuration": kept}, notes


def _families(document: Document, reader: FamilyReader) -> Iterator[Family]:
    """The readable parts of every family, despite faults elsewhere in the file."""
    raw = document.data.get("configuration")
    for i, entry in enumerate(raw if isinstance(raw, list) else []):
        if isinstance(entry, dict):
            dimensions = entry.get("dimensions")
            tags = dimensions if isinstance(dimensions, dict) else {}
            yield reader.read(("configuration", i), str(entry.get("name")), tags)


def _family_set_faults(document: Document) -> list[Fault]:
    raw = document.data.get("configuration")
    search = document.data.get("search")
    if raw and search:
        return [document.fault(("search",), "a campaign with a configuration has no search", "remove one", "key")]
    if raw in (None, [], {}) and search is None:
        return [document.fault(("configuration",), "the campaign is empty", "add a family, '- name: room'", "key")]
    faults: list[Fault] = []
    lines: dict[str, int] = {}
    for i, entry in enumerate(raw if isinstance(raw, list) else []):
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str):
            continue
        where: Location = ("configuration", i, "name")
        for other in lines:
            short, long = sorted((name, other), key=len)
            if name == other:
                what, right = f"duplicate family {name!r}, the first is in line {lines[name]}", "choose another name"
            elif re.fullmatch(rf"{re.escape(short)}(-[0-9]+)*", long):  # as the other's configurations are called
                what = f"{long!r} is also the name of a configuration of family {short!r}"
                right = "choose a name that is not the other's with a number"
            else:
                continue
            faults.append(document.fault(where, what, right))
            break
        lines.setdefault(name, document.place(where)[0])
    return faults


def oracle_requests(evaluation: EvaluationSpec) -> list[OracleRequest]:
    """The oracles that a file's section `evaluation` asks for, in its order."""
    return [
        OracleRequest(name, parameters, ("evaluation", "oracles", k, name))
        for k, entry in enumerate(evaluation.oracles)
        for name, parameters in entry.items()
    ]


def _oracle_faults(document: Document) -> list[Fault]:
    """Report duplicate oracles, because their verdicts would be indistinguishable."""
    entries = document.value(("evaluation", "oracles"))
    faults: list[Fault] = []
    seen: set[str] = set()
    for k, entry in enumerate(entries if isinstance(entries, list) else []):
        for name in [entry] if isinstance(entry, str) else entry if isinstance(entry, dict) else ():
            if name in seen:
                where: Location = ("evaluation", "oracles", k, name)
                faults.append(document.fault(where, f"duplicate oracle {name!r}", "keep one of them", "key"))
            seen.add(name)
    return faults


def most_configurations(family: Family) -> int:
    """The maximum number of configurations of a family, from the choices that its producers declare.

    A design takes some of the combinations, so of a family with one it is the choices of its largest producer.
    """
    choices = [producer.most_choices or 1 for producer in family.producers]
    return math.prod(choices) if family.design.cartesian is not None else max(choices, default=1)


def size_faults(document: Document, families: Sequence[Family], execution: ExecutionSpec) -> list[Fault]:
    """More configurations or runs than the file permits, each with the number and the key that permits it."""
    asked = [most_configurations(family) for family in families]
    total, permitted = sum(asked), execution.max_configurations
    if total <= permitted:
        each = execution.runs.max if isinstance(execution.runs, Sequential) else execution.runs
        return runs_faults(document, total, execution, each)
    where = document.known(("configuration", asked.index(max(asked)), "variations"))
    here = f", {max(asked):,} of them here" if max(asked) < total else ""
    what = f"the campaign asks for {total:,} configurations{here}"
    right = f"at most {permitted:,} are allowed, unless 'execution: {{max_configurations: {total}}}' permits more"
    return [document.fault(where, what, right, "key")]


def runs_faults(document: Document, configurations: int, execution: ExecutionSpec, runs: int) -> list[Fault]:
    """The fault of a campaign with more runs than its file permits."""
    total = runs * configurations
    if total <= execution.max_runs:
        return []
    what = f"the campaign asks for {total:,} runs, {runs:,} of each configuration"
    right = f"at most {execution.max_runs:,} are allowed, unless 'execution: {{max_runs: {total}}}' permits more"
    return [document.fault(document.known(("execution", "runs")), what, right, "key")]


def infeasible_lengths(campaign: Campaign) -> list[Fault]:
    """Path lengths that the maps of a campaign's families don't have.

    Where a map or poses follow from other producers, nothing is proved.

    Raises:
        FileError: no family has a path length that its map has.
    """
    families = campaign.families if campaign.spec.search is None else ()
    found = {family.name: list(_of_family(campaign, family)) for family in families}
    faults = [fault for family in found.values() for fault, _ in family]
    if found and all(any(is_all for _, is_all in family) for family in found.values()):
        raise FileError(faults)
    return [replace(each, kind="warning") for each in faults]


def _of_family(campaign: Campaign, family: Family) -> Iterator[tuple[Fault, bool]]:
    """A fault for each length that is proved infeasible, and whether its producer is left with no other."""
    entries = campaign.document.data["configuration"]
    i = next(i for i, entry in enumerate(entries) if entry["name"] == family.name)
    written: set[str] = set()
    for k, each in enumerate(family.producers):
        if isinstance(each, PathVariationRandom) and written.isdisjoint(each.reads):
            inputs = {key: family.values[key] for key in each.reads if key in family.values}
            one = PathVariationRandom(each.parameters.model_copy(update={"num_paths": 1}))
            results = evaluate(one, inputs)
            proved = [item for item in results if isinstance(item, Rejection) and UNPROVED not in item.reason]
            where = ("configuration", i, "variations", k, *entries[i]["variations"][k], "path_length")
            for item in proved:
                what = f"{each.parameters.num_paths} configurations of family {family.name!r} are rejected"
                yield campaign.fault(where, what, item.reason), len(proved) == len(results)
        written |= each.writes.keys()
