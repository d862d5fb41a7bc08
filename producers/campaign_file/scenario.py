"""The scenario of a campaign: its abstract scenario, and the files for programs."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Final

from vastflow.producers.campaign_file.containers import containers_of
from vastflow.producers.campaign_file.document import Document
from vastflow.producers.campaign_file.nodes import nodes_of
from vastflow.producers.campaign_file.spec import ExecutionSpec
from vastflow.producers.model.faults import Location
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.sim.model.digest import FileContent, Value, file_digest
from vastflow.sim.model.faults import Complaint, Fault, FileError, Got, ScenarioError
from vastflow.sim.model.files import Unreadable, is_file
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.scenario import ProcessSetup, RunFiles
from vastflow.sim.reading.abstract import BUILTIN, SHIPPED, abstract_content, definition_of
from vastflow.sim.reading.script import calls_of, goal_keys, is_optional_list, overrides_of
from vastflow.sim.reading.vocabulary import ACTIONS, WORLDLY
from vastflow.sim.scenario.definition import ScenarioDefinition
from vastflow.sim.scenario.language.parameters import ParameterMismatch, bound, default_of
from vastflow.sim.scenario.programs.actions import PROCESSES
from vastflow.sim.scenario.programs.config_files import read_tree
from vastflow.sim.scenario.programs.folders import CONFIG, below_config, files_matching, unmatched
from vastflow.sim.scenario.tree.support import unsupported
from vastflow.sim.world.environment import MAP_KEY

WHERE: Final[Location] = ("execution", "scenario_file")

Group = tuple[str, ...]
"""Keys of which one is needed."""


@dataclass(frozen=True)
class AbstractScenario:
    """An abstract scenario and its requirements.

    Attributes:
        name: Name in the campaign file; empty where the mission follows from the goal.
        content: Scenario file or built-in name as a `Scenario` gets it; empty where the name is.
        definition: None where there are several, one for each kind of goal.
    """

    name: str
    content: str | FileContent
    definition: ScenarioDefinition | None

    @property
    def needed(self) -> Sequence[Group]:
        """Keys that every configuration needs, one of each group."""
        if self.definition is None:
            return ((MAP_KEY,), (START_KEY,), (GOAL_KEY, GOALS_KEY))
        groups: list[Group] = [(MAP_KEY,)] if self.in_world and not self.launches_own_map else []
        calls = {action.rpartition(".")[2] for action in self.actions}
        if self.in_world and "init_nav2" not in calls and START_KEY not in self.parameters:
            groups.append((START_KEY,))
        for parameter in self.definition.parameters:
            if parameter.default is None and not is_optional_list(parameter):
                groups.append((GOALS_KEY, GOAL_KEY) if parameter.name == GOALS_KEY else (parameter.name,))
        return groups

    @property
    def actions(self) -> frozenset[str]:
        """Names of the actions that it calls."""
        return frozenset(call.action for call in calls_of(self.definition.root)) if self.definition else frozenset()

    @property
    def launches_own_map(self) -> bool:
        """Whether it launches a simulation with a map that no parameter names."""
        return MAP_KEY not in self.parameters and "ros_launch" in self.actions

    @property
    def optional_objects(self) -> tuple[str, ...]:
        """Its optional parameters that hold objects to spawn."""
        parameters = self.definition.parameters if self.definition else ()
        return tuple(each.name for each in parameters if is_optional_list(each))

    def goal_keys(self, keys: Collection[str]) -> tuple[str, ...]:
        """Return the keys with several goals although the file's scenario has one; the robot visits all."""
        if self.definition is None or not isinstance(self.content, FileContent):
            return ()
        return goal_keys(self.definition, keys)

    @property
    def in_world(self) -> bool:
        """Whether it does anything in the simulated world."""
        return self.definition is None or not self.actions.isdisjoint(WORLDLY)

    @property
    def parameters(self) -> frozenset[str]:
        """Names of its parameters."""
        return frozenset(each.name for each in self.definition.parameters) if self.definition else frozenset()

    def complaint(self, key: str, value: Value) -> Complaint | None:
        """Return the problem of a parameter's value, and the expected value."""
        if self.definition is None or key not in self.parameters:
            return None
        alone = replace(self.definition, parameters=tuple(p for p in self.definition.parameters if p.name == key))
        try:
            bound(alone, overrides_of(alone, {key: value}))
        except ParameterMismatch as error:
            return Got(error.given), f"{error.expected}, for it is a parameter of {self.name}"
        return None


FROM_GOAL: Final = AbstractScenario("", "", None)
"""The scenario of a campaign whose mission follows from the goal."""


def abstract_scenario_of(document: Document, base: Path) -> tuple[AbstractScenario | None, list[Fault]]:
    """Read what `execution.scenario_file` names, or say everything that is wrong with it."""
    name = document.value(WHERE)
    if not isinstance(name, str):
        return FROM_GOAL, []
    if name.startswith(BUILTIN):
        if name.removeprefix(BUILTIN) not in SHIPPED:
            right = did_you_mean(name, [BUILTIN + each for each in SHIPPED])
            return None, [document.fault(WHERE, f"unknown scenario {name!r}", right)]
        return AbstractScenario(name, name, definition_of(name)), []
    file = base / name
    if not is_file(file):
        return None, [document.fault(WHERE, f"there is no file {name!r}", "expected an OpenSCENARIO DSL file")]
    try:
        content = abstract_content(file)
        definition = definition_of(content)
    except FileError as error:
        return None, [replace(fault, place=replace(fault.place, where="scenario")) for fault in error.faults]
    except ScenarioError as error:
        return None, [document.fault(WHERE, str(error), "")]
    faults = list(unsupported(definition, ACTIONS))
    for p in definition.parameters:
        if p.default is not None and default_of(definition, p.name) is None:
            what = f"the default of parameter {p.name} is not known before a run"
            faults.append(Fault(p.place, what, "write a value, or a var in place of a parameter"))
    if faults:
        return None, [replace(each, place=replace(each.place, file=str(file), where="scenario")) for each in faults]
    return AbstractScenario(name, content, definition), []


KEYS: Final = ("run_files", "config_files", "env", "pre_command", "post_command", "containers", "container_runtime")
CONTAINERS: Final[Collection[Location]] = [("execution", name) for name in ("image", "secondary_containers")]
"""Keys that describe containers, and are executed where `containers_of` says so."""


def programs_of(
    document: Document, base: Path, execution: ExecutionSpec, abstract: AbstractScenario
) -> tuple[ProcessSetup | None, list[Fault], list[Fault]]:
    """Return the setup of a campaign with programs; otherwise None with a note on each unused key.

    Files named by `pre_command` and `post_command` that lie below the campaign file's folder are run files too: what is in
    them counts.
    """
    given = [key for key in KEYS if getattr(execution, key)]
    nodes = nodes_of(execution.nodes, execution.ros2) if execution.system == "ros2" else None
    starts_none, what = abstract.actions.isdisjoint(PROCESSES), "it has no effect"
    unused = {"nodes", "ros2"} & execution.model_fields_set if nodes is None else ()
    idle = [document.note("warning", ("execution", key), what, "write 'system: ros2'") for key in sorted(unused)]
    if starts_none and nodes is None:
        why = "the scenario starts no program"
        return None, [*idle, *(document.note("not executed", ("execution", key), what, why) for key in given)], []
    if starts_none and nodes is not None and not nodes.processes:
        right = "give execution.nodes, or a scenario that starts them"
        return None, [], [document.fault(("execution", "system"), "no node drives the robot", right)]
    scripts, notes, faults = _scripts(document, base, execution)
    notes += idle
    files: RunFiles = ()
    try:
        files = run_files(base, execution.run_files)
        notes += [
            document.note("warning", ("execution", "run_files"), f"no file matches {pattern!r}")
            for pattern in unmatched(files, execution.run_files)
        ]
    except ScenarioError as error:
        faults.append(document.fault(("execution", "run_files"), str(error), ""))
    config = {name: str(below_config(path)) for name, path in execution.config_files.items()}
    for name, path in config.items():
        try:
            read_tree(base / path)
        except Unreadable as error:
            where = ("execution", "config_files", name)
            faults.append(document.fault(where, f"{path}:{error.place[0]}:{error.place[1]}: {error}"))
    environment = {  # YAML's `true` is `true`, as a shell would have it
        name: str(value).lower() if isinstance(value, bool) else "" if value is None else str(value)
        for entry in execution.env
        for name, value in entry.items()
    }
    folder = PurePosixPath(execution.scenario_file or "").parent
    named = [path for path in (*scripts, *config.values()) if is_file(base / path)]
    own = {path: FileContent(str(base / path), file_digest(base / path)) for path in named}
    setup = ProcessSetup(
        tuple(sorted({**own, **dict(files)}.items())),
        environment,
        execution.pre_command or "",
        execution.post_command or "",
        "" if folder == PurePosixPath() else folder.as_posix(),
        containers_of(
            execution.containers, execution.container_runtime, execution.image, execution.secondary_containers
        ),
        "" if execution.container_runtime in (None, "any") else str(execution.container_runtime),
        nodes,
        config,
    )
    return setup, notes, faults


def _scripts(document: Document, base: Path, execution: ExecutionSpec) -> tuple[list[str], list[Fault], list[Fault]]:
    """The files below `base` that `pre_command` and `post_command` name, with notes on them."""
    found: list[str] = []
    notes: list[Fault] = []
    faults: list[Fault] = []
    for key in ("pre_command", "post_command"):
        command = getattr(execution, key) or ""
        program = command if _is_file(base, command) else (command.split() or [""])[0]
        if not program or (key == "post_command" and "/" not in program and not _is_file(base, program)):
            continue  # nothing, or a program that PATH leads to
        where: Location = ("execution", key)
        if _is_file(base, program):
            found.append(str(below_config(program)))
        elif PurePosixPath(program).is_absolute() and not PurePosixPath(program).is_relative_to(CONFIG):
            if not is_file(program):
                right = f"a file beside the campaign is {CONFIG}/NAME"
                notes.append(document.note("warning", where, f"this machine has no {program!r}", right))
        else:
            right = "expected a file below the campaign file's folder"
            faults.append(document.fault(where, f"there is no file {program!r}", right))
    return found, notes, faults


def _is_file(base: Path, name: str) -> bool:
    inside = below_config(name)
    return inside is not None and is_file(base / inside)


def run_files(base: Path, patterns: Sequence[str]) -> RunFiles:
    """The files below the campaign file's folder that match one of `patterns`, see `files_matching`.

    What campaigns have left there, their directories and exports of them, is not looked at: with copies of its own files in
    them a campaign would be another one after each run of it.

    Raises:
        ScenarioError: a pattern that can't be used.
    """

    def is_left_by_a_campaign(folder: Path) -> bool:
        written = all(is_file(folder / name) for name in ("campaign.vast", "metadata.json"))
        return written or is_file(folder / "_config" / "campaign.vast")

    return files_matching(base, patterns, is_left_by_a_campaign)
