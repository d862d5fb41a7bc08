"""Actions of `osc.helpers`, `osc.os`, and `osc.dataops` that need processes or a folder."""

import functools
import re
import shlex
import signal
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import psutil
import yaml
from py_trees.common import Status

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.files import Unreadable, read_text, yaml_value
from vastflow.sim.scenario.definition import EnumValue
from vastflow.sim.scenario.programs.folders import RunFolders
from vastflow.sim.scenario.programs.process import ProcessGroup
from vastflow.sim.scenario.programs.run import ProcessRun
from vastflow.sim.scenario.tree.action import Action, ActionFactory, ActionSituation, Immediate

_TRUTHS: Final[Mapping[str, bool]] = {"true": True, "false": False}
_TYPES: Final[Mapping[str, Callable[[str], Any]]] = {
    "str": str,
    "int": int,
    "float": float,
    "bool": lambda text: _TRUTHS[text.lower()],
}


def set_yaml_value(
    source: Path, target: Path, key_path: str, value: str, value_type: str, create_missing: bool
) -> None:
    """Set one value of the document in `source` and write it to `target`; comments are lost.

    Args:
        key_path: Keys, and indices of lists, with dots between: `controller.plugins.0`.
        value_type: `str`, `int`, `float` or `bool`.
        create_missing: Make mappings that are not there.

    Raises:
        ValueError: a file that can't be read or written, a path that leads nowhere, or a value not of its type.
    """
    try:
        typed = _TYPES[value_type](value)
    except KeyError:
        right = "true or false" if value_type == "bool" else f"a value_type of {', '.join(_TYPES)}"
        found = repr(value) if value_type == "bool" else f"value_type {value_type!r}"
        raise ValueError(f"expected {right}, got {found}") from None
    except ValueError:
        raise ValueError(f"expected one of type {value_type}, got value {value!r}") from None

    def at(place: Any, key: str) -> str | int:
        if isinstance(place, dict) and (create_missing or key in place):
            return key
        if isinstance(place, list) and key.isdigit() and int(key) < len(place):
            return int(key)
        raise ValueError(f"key_path {key_path!r} leads nowhere: there is no {key!r}")

    try:
        document = yaml_value(read_text(source, "a YAML file"))
        place = document = {} if document is None else document
        *parents, last = key_path.split(".")
        for key in parents:
            place = place.setdefault(at(place, key), {}) if isinstance(place, dict) else place[at(place, key)]
        place[at(place, last)] = typed
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(yaml.safe_dump(document, sort_keys=False, allow_unicode=True))
    except Unreadable as error:
        raise ValueError(f"{str(source)!r}: {error}") from None
    except OSError as error:
        raise ValueError(f"{error.filename!r}: {error.strerror}") from None


SHUTDOWN_TIMEOUT_S: Final = 10.0


class RunAction(Action):
    def __init__(self, run: ProcessRun, situation: ActionSituation) -> None:
        self.run = run
        self.situation = situation


class RunProcess(RunAction):
    """`run_process`: starts a program; succeeds if it exits with code 0, or at once if not awaited.

    The command is split into words as a shell does, with quotes; no shell runs it. It starts in the run's folder. A scenario whose
    program can't be started can't work: `ScenarioError`.
    Given up, or at the end of the scenario, it gets `shutdown_signal` and is killed `shutdown_timeout` of host time later.
    """

    def __init__(self, run: ProcessRun, situation: ActionSituation) -> None:
        super().__init__(run, situation)
        self._begun: list[ProcessGroup] = []

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self._awaited = arguments.get("wait_for_shutdown", True)
        given = arguments.get("shutdown_signal", signal.SIGTERM)
        name = given.member.upper() if isinstance(given, EnumValue) else ""
        # This machine's number of the signal, if it has one of this name.
        self._signal = (
            signal.Signals[name] if name in signal.Signals.__members__ else int(getattr(given, "number", given))
        )
        self._timeout_s = float(arguments.get("shutdown_timeout", SHUTDOWN_TIMEOUT_S))
        try:
            command = shlex.split(arguments["command"])
        except ValueError as error:  # a quote that is not closed
            raise ScenarioError(f"command {arguments['command']!r}: {str(error).lower()}") from None
        if not command:
            raise ScenarioError("expected a command, got nothing")
        self._begun.append(self.run.start(command, self.situation.label))
        self.message = f"running {shlex.join(command)}"
        self.situation.log(self.message)

    def update(self) -> Status:
        if not self._awaited:
            return Status.SUCCESS
        group = self._begun[-1]
        failure = group.failure
        if failure is None:
            return Status.RUNNING
        words = group.with_last_line(failure) if failure else "exited with code 0"
        self.message = f"{Path(group.command[0]).name} {words}"
        return Status.FAILURE if failure else Status.SUCCESS

    def cancel(self) -> None:
        self._begun[-1].stop(self._signal, self._timeout_s)

    def shutdown(self) -> None:
        for group in self._begun:
            group.stop(self._signal, self._timeout_s)


class ProcessLogCheck(RunAction):
    """`process_log_check`: succeeds once the labeled `run_process` has printed one of `values`.

    It fails where the process ended, or its log was cut, before: no value can appear any more.
    """

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self._label = arguments["process_name"]
        self._values = [value.encode() for value in arguments["values"]]
        self._group = self.run.labeled(self._label)
        self._offset = 0
        if self._group is not None and not arguments.get("from_start", True):
            self._offset = self._group.log.path.stat().st_size

    def update(self) -> Status:
        self._group = self._group or self.run.labeled(self._label)
        if self._group is None:
            self.message = f"no run_process labeled {self._label!r} has begun"
            return Status.RUNNING
        log = self._group.log
        over = log.complete.is_set() or log.cut
        printed = log.read(self._offset)
        came = next((value for value in self._values if value in printed), None)
        if came is not None:
            self.message = f"{self._label!r} printed {came.decode()!r}"
            return Status.SUCCESS
        longest = max(map(len, self._values), default=0)
        self._offset += max(0, len(printed) - longest)  # a value may have come in half
        wanted = " or ".join(repr(value.decode()) for value in self._values)
        self.message = f"{self._label!r} has not printed {wanted}"
        if over:
            why = "its log was cut" if log.cut else "it ended"
            self.message = f"{why} before {self._label!r} printed {wanted}"
        return Status.FAILURE if over else Status.RUNNING


class CheckProcessRunning(RunAction, Immediate):
    """`check_process_running`: whether a process of this run has a text in its name, label or command line.

    With `regex` the text is a regular expression. Processes of other runs and of the machine are none of this run's.
    """

    def act(self, arguments: Mapping[str, Any]) -> bool:
        wanted = arguments["process_name"]
        try:
            pattern = re.compile(wanted if arguments.get("regex", False) else re.escape(wanted))
        except re.error as error:
            raise ScenarioError(f"{wanted!r} is no regular expression: {error}") from None
        texts = self.run.running_labels()
        for pid in self.run.pids():
            with suppress(psutil.NoSuchProcess, psutil.AccessDenied):
                process = psutil.Process(pid)
                texts.append(f"{process.name()} {' '.join(process.cmdline())}")
        running = any(map(pattern.search, texts))
        self.message = f"{'a' if running else 'no'} process {wanted!r} of this run is running"
        return running


class CheckFileExists(RunAction, Immediate):
    """`check_file_exists`: whether a file or folder exists, relative to the run's folder."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        name = arguments["file_name"]
        there = self.run.folders.path(name).exists()
        self.message = f"{name!r} is {'' if there else 'not '}there"
        return there


class CheckFileNotExists(CheckFileExists):
    """`check_file_not_exists`: the contrary."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        return not super().act(arguments)


class MonitorResources(RunAction):
    """`monitor_resources`: runs until the scenario ends, and writes the processes' usage to `file_name`."""

    _file: Path | None = None

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self._file = _written_to(self.run.folders, arguments["file_name"])
        if self._file is None:
            raise ScenarioError(f"expected a file below the run's folder, got {arguments['file_name']!r}")
        self.message = f"resources go to {arguments['file_name']!r}"

    def update(self) -> Status:
        return Status.RUNNING

    def shutdown(self) -> None:
        if self._file is None:
            return
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            rows = ((f"{row.t_s:.3f}", f"{row.cpu_s:.2f}", row.rss_bytes, row.processes) for row in self.run.resources)
            lines = (",".join(map(str, row)) + "\n" for row in [("t_s", "cpu_s", "rss_bytes", "processes"), *rows])
            self._file.write_text("".join(lines))
        except OSError as error:
            self.situation.log(f"monitor_resources could not write {error.filename!r}: {error.strerror}")


class SetYamlValue(RunAction, Immediate):
    """`set_yaml_value`: sets the value at `key_path` of a YAML file, `a.b.0`, and writes it back or to `output_file`.

    What it writes lies in the run's folder.
    """

    def act(self, arguments: Mapping[str, Any]) -> bool:
        source = self.run.folders.path(arguments["file_path"])
        name = arguments.get("output_file") or arguments["file_path"]
        target = _written_to(self.run.folders, name)
        if target is None:
            raise ScenarioError(f"set_yaml_value: expected an output_file in the run's folder, got {name!r}")
        try:
            set_yaml_value(
                source,
                target,
                arguments["key_path"],
                arguments["value"],
                arguments.get("value_type", "str"),
                arguments.get("create_missing", True),
            )
        except ValueError as fault:
            self.message = str(fault)
            return False
        self.message = f"set {arguments['key_path']} to {arguments['value']}"
        return True


def _written_to(folders: RunFolders, name: str) -> Path | None:
    """Return the file that programs know by `name`, or None outside of the run's folder."""
    path = folders.path(name).resolve()
    return path if path.is_relative_to(folders.out) else None


PROCESSES: Final[Mapping[str, Callable[[ProcessRun, ActionSituation], Action]]] = {
    "run_process": RunProcess,
    "process_log_check": ProcessLogCheck,
    "check_process_running": CheckProcessRunning,
    "check_file_exists": CheckFileExists,
    "check_file_not_exists": CheckFileNotExists,
    "monitor_resources": MonitorResources,
    "set_yaml_value": SetYamlValue,
}
"""Actions by their names in a file."""


def process_actions(run: ProcessRun) -> dict[str, ActionFactory]:
    """Return the factories of all actions on `run` by name."""
    return {name: functools.partial(action, run) for name, action in PROCESSES.items()}
