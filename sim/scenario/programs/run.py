"""A run of programs: its folder, environment, processes, and outputs."""

import json
import os
import secrets
import shlex
import subprocess
import sys
import tempfile
import threading
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import TYPE_CHECKING, Final

import psutil

from vastflow.sim.model.container import MAIN
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.files import read_bytes
from vastflow.sim.model.recording import LogText, Outputs, Use
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs import guard
from vastflow.sim.scenario.programs.config_files import write_parameters
from vastflow.sim.scenario.programs.folders import (
    BUBBLEWRAP,
    CONFIG,
    OUT,
    MountNamespace,
    RunFolders,
    can_mount,
    copy_in,
    hand_over,
    named_in,
)
from vastflow.sim.scenario.programs.guard import VARIABLE, clean, kill_marked, marked, remove_folder
from vastflow.sim.scenario.programs.outputs import Stamp, read_outputs, stamps
from vastflow.sim.scenario.programs.process import RSS_UNIT_BYTES, ProcessGroup, Usage, kill_all
from vastflow.sim.scenario.programs.resources import ResourceSampler

if TYPE_CHECKING:
    from vastflow.sim.scenario.programs.containers import RunContainers

COMMAND_TIMEOUT_S: Final = 600.0
"""Host time that `pre_command` and `post_command` may take."""
_NOT_TAKEN: Final = ("_", "SHLVL", "PWD", "OLDPWD", VARIABLE)
"""Variables of the shell itself that are not exported."""
_SOURCE: Final = """\
vastflow_result=$1 vastflow_script=$2
shift 2
source "$vastflow_script" "$@" || exit
command env -0 >"$vastflow_result"
"""

MAX_LOGS_BYTES: Final = 64 * 2**20


@dataclass(frozen=True)
class ProcessRecord:
    """The outputs and logs of a run of programs.

    Attributes:
        resources: Once a second of host time.
        usage: Usage of all its processes. Those that lived less than a second, and those that nobody waited for, may be missing.
        post_command: Failure of `post_command` in words; empty where it exited with code 0 or there is none.
        note: What ran containers; empty without any.
    """

    outputs: Outputs
    logs: tuple[LogText, ...]
    resources: tuple[Use, ...]
    usage: Usage
    post_command: str
    note: str = ""


def _check_mounts() -> None:
    if not can_mount():
        raise ScenarioError(
            f"a program that names {CONFIG} or {OUT} needs {BUBBLEWRAP}, which is missing or may not make namespaces here. "
            "Install it with `apt install bubblewrap`."
        )


class ProcessRun:
    """The processes of one run, see `process_run`.

    Attributes:
        folders: `folders.out` is where its programs work, and what they write is looked for.
        environment: Environment variables of its programs.
    """

    def __init__(
        self, root: Path, setup: ProcessSetup, handed: Mapping[str, FileContent], holds: Sequence[int] = ()
    ) -> None:
        self.folders = RunFolders.below(root)
        self.environment = {**os.environ, **setup.environment}
        self._setup = setup
        self._handed = handed
        self._named = named_in([setup.pre_command, setup.post_command, *setup.environment.values()])
        # A run inside of another's process bears that one's mark too.
        self._mark = f"{os.environ.get(VARIABLE, '')}{uuid.uuid4().hex}."
        self._namespace: MountNamespace | None = None
        self._groups: list[ProcessGroup] = []
        self._staying: set[int] = set()
        self._news = threading.Event()
        self._guard = subprocess.Popen(  # before there is a folder, lest it be left behind
            [sys.executable, "-I", "-S", guard.__file__, self._mark, str(root)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={name: value for name, value in os.environ.items() if name != VARIABLE},
            pass_fds=holds,
            start_new_session=True,
        )
        self._removals: list[Sequence[str]] = []
        self._is_clean = False
        self._containers: RunContainers | None = None
        self._sampler: ResourceSampler | None = None
        self._before: Mapping[str, Stamp] = {}
        self._usages: list[Usage] = []

    def begin(self) -> None:
        """Fill the folders and source `pre_command`.

        Raises:
            ScenarioError: a run file changed or is gone, or `pre_command` failed: no bash, an exit code other than 0, or no
                end in time. The run is not to be judged.
        """
        folders = self.folders
        folders.out.parent.mkdir(0o700)
        for folder in (folders.config, folders.out, folders.logs):
            folder.mkdir()
        for folder in (folders.config, folders.out):
            copy_in(self._setup.files, folder)
            write_parameters(self._setup.parameters, folder)
            hand_over(self._handed, folder)
        if self._setup.containers:
            from vastflow.sim.scenario.programs.containers import RunContainers  # seldom needed

            self._containers = RunContainers(folders, self._setup, self.at_end)
            if self.in_main:  # where none of this machine's variables are
                self.environment = {**self._setup.environment}
        self._named = not self.in_main and (self._named or folders.named_in_files())
        if self._named:
            _check_mounts()
        self._before = stamps(folders.out)
        if self._setup.pre_command:
            self.environment = self._sourced((folders.out if self.in_main else folders.logs) / ".environment")
            self._news.clear()
        if self._containers is not None:
            stays = self._setup.nodes is not None
            self._containers.begin(lambda command, name: self.start(command, name, container=name, stays=stays))

    def start(
        self,
        command: Sequence[str],
        label: str = "",
        *,
        container: str = "main",
        stays: bool = False,
        environment: Mapping[str, str] | None = None,
    ) -> ProcessGroup:
        """Start `command` in the run's folder, in a container if there is this one; ScenarioError if it can't be.

        Args:
            stays: Whether nothing waits for its end: simulated time goes on as if it were not there.
            environment: Its variables in place of `environment`.
        """
        number = len(self._groups)
        mark, environment = f"{self._mark}{number}.", self.environment if environment is None else environment
        started = self._containers.launched(container, command, mark, environment) if self._containers else None
        if started is not None:
            environment = {**os.environ}
        named = started is None and (self._named or named_in(command))
        if named and self._namespace is None:
            _check_mounts()
            self._namespace = MountNamespace.of(self.folders.mounts)
        group = ProcessGroup(
            started.client if started else command,
            folders=self.folders,
            namespace=self._namespace if named else None,
            environment=environment,
            log_file=self.folders.logs / f"{number}.log",
            mark=mark,
            label=label,
            on_end=self._news.set,
        )
        self._groups.append(group)
        if stays:
            self._staying.add(number)
        if started is not None:
            started.group, group.command = group, tuple(command)
        if self._sampler is None:
            self._sampler = ResourceSampler(self.pids, self._containers.cgroups if self._containers else tuple)
        return group

    def at_end(self, command: Sequence[str]) -> None:
        """Have a command executed when the run has ended, by the guard if this process is killed."""
        self._removals.append(command)
        assert self._guard.stdin is not None
        self._guard.stdin.write(json.dumps(command).encode() + b"\n")
        self._guard.stdin.flush()

    @property
    def in_main(self) -> bool:
        return MAIN in self._setup.containers

    @property
    def waiting(self) -> bool:
        """True if a command is running, which needs host time."""
        return any(group.failure is None and k not in self._staying for k, group in enumerate(self._groups))

    def wait(self, timeout_s: float) -> None:
        """Return once a command has ended since the last call, none runs, or `timeout_s` of host time is over.

        Raises:
            ScenarioError: a container broke the run, see `RunContainers.check`.
        """
        if self.waiting:
            self._news.wait(timeout_s)
        self._news.clear()
        self.check()

    def check(self) -> None:
        """Raise `ScenarioError` if a container broke the run, see `RunContainers.check`."""
        if self._containers is not None:
            self._containers.check()

    def labeled(self, label: str) -> ProcessGroup | None:
        """Return the last command with this label."""
        return next((group for group in reversed(self._groups) if group.label == label), None)

    def running_labels(self) -> list[str]:
        return [group.label for group in self._groups if group.label and group.failure is None]

    def pids(self) -> set[int]:
        """Return the ids of all living processes of the run."""
        pids = set(marked(self._mark))
        for group in tuple(self._groups):
            if group.failure is None:
                with suppress(psutil.NoSuchProcess):
                    pids |= {group.pid, *(child.pid for child in psutil.Process(group.pid).children(recursive=True))}
        return pids

    @property
    def resources(self) -> tuple[Use, ...]:
        """The resource samples so far, one a second since the first process."""
        return tuple(self._sampler.rows) if self._sampler else ()

    def close(self) -> ProcessRecord:
        """Stop all programs, run `post_command`, and read the output; called once.

        Programs that should be asked before they are killed have to be stopped first.
        """
        self.check()
        for group in reversed(self._groups):
            group.stop(timeout_s=0.0)
        post_command = self._post_command() if self._setup.post_command else ""
        resources = self._sampler.stop() if self._sampler else ()
        self.end()
        waited_s, sampled_s = sum(usage.cpu_s for usage in self._usages), resources[-1].cpu_s if resources else 0.0
        # A process begins with its parent's peak for its own, so the system's figure counts only where it is greater than
        # this process' peak; else the samples are what there is.
        own = getrusage(RUSAGE_SELF).ru_maxrss * RSS_UNIT_BYTES
        peaks = [usage.max_rss_bytes for usage in self._usages if usage.max_rss_bytes > own]
        usage = Usage(max(waited_s, sampled_s), max([*peaks, *(row.rss_bytes for row in resources)], default=0))
        note = self._containers.note if self._containers else ""
        outputs = read_outputs(self.folders.out, self._before)
        return ProcessRecord(outputs, self._logs(), resources, usage, post_command, note)

    def end(self) -> None:
        """Leave nothing running, or raise RuntimeError; may be called again."""
        left = kill_marked(self._mark)  # all at once first, so that none is spared should another not end
        if len(self._usages) < len(self._groups):
            self._usages = [group.release() for group in self._groups]
        if self._sampler:
            self._sampler.stop()
            kill_all(self._sampler.processes)  # who left its family and dropped its mark was perhaps seen before
        self._is_clean = self._is_clean or clean(self._removals)
        if self._namespace is not None:
            self._namespace.close()
            self._namespace = None
        if left:
            raise RuntimeError(f"processes {sorted(left)} of a run could not be killed")

    def check_disk(self) -> None:
        """Raise `OSError` if the folder's disk is or was full.

        Programs seldom say so, and what they wrote is no result.
        """
        folder = self.folders.out.parent
        try:
            for problem in filter(None, (group.log.problem for group in self._groups)):
                raise problem
            with tempfile.TemporaryFile(dir=folder.parent) as file:
                file.write(b"1" * 65536)  # what was removed just now may have made some room
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(folder)) from None

    def remove(self) -> None:
        """Remove the folder, and dismiss the guard; it goes on where a runtime may be about to make a container."""
        remove_folder(self.folders.out.parent)
        if self._is_clean:
            self._guard.kill()
        assert self._guard.stdin is not None
        self._guard.stdin.close()
        if self._is_clean:
            self._guard.wait()

    def _sourced(self, result: Path) -> dict[str, str]:
        """Return the environment after bash has sourced `pre_command`, which leaves it in the file `result`.

        Background processes of the script run on. Its path needs no quotes for blanks.
        """
        given = self._setup.pre_command
        script, *arguments = [given] if self.folders.path(given).is_file() else _words(given)
        if not self.folders.path(script).is_file():
            raise ScenarioError(f"pre_command: there is no file {script!r}")
        shown = f"{OUT}/{result.name}" if self.in_main else str(result)
        command = ["bash", "-c", _SOURCE, "bash", shown, self._seen(script), *arguments]
        try:
            group = self.start(command, "pre_command")
        except ScenarioError as error:
            raise ScenarioError(f"pre_command: {error}") from None
        name = Path(script).name
        if failure := _failure(group):
            raise ScenarioError(f"pre_command {name!r} {group.with_last_line(failure)}")
        if not result.exists():
            raise ScenarioError(f"pre_command {name!r} left the shell that sources it. It must not call exit.")
        entries = [os.fsdecode(entry).partition("=") for entry in read_bytes(result).split(b"\0") if entry]
        result.unlink()
        return {name: value for name, _, value in entries if name not in _NOT_TAKEN}

    def _post_command(self) -> str:
        try:
            program, *arguments = _words(self._setup.post_command)
            group = self.start([self._seen(program), *arguments, OUT], "post_command")
        except ScenarioError as error:
            return str(error)
        return _failure(group)

    def _seen(self, program: str) -> str:
        """Return the whole path of a file in the run's folder, else the program's name."""
        here = self.folders.out / program
        return (f"{OUT}/{program}" if self.in_main else str(here)) if here.is_file() else program

    def _logs(self) -> tuple[LogText, ...]:
        texts, left_bytes = [], MAX_LOGS_BYTES
        for group in self._groups:
            content = group.log.read()
            cut = group.log.cut or len(content) > left_bytes
            text = content[:left_bytes].decode(errors="replace")
            texts.append(LogText(group.label, group.command, text, cut))
            left_bytes -= min(left_bytes, len(content))
        return tuple(texts)


def _failure(group: ProcessGroup) -> str:
    """Return why a command failed, which is killed after `COMMAND_TIMEOUT_S`; empty if it did not."""
    if (failure := group.wait(COMMAND_TIMEOUT_S)) is not None:
        return failure
    group.stop(timeout_s=0.0)
    return f"took longer than {COMMAND_TIMEOUT_S:g} s and was killed"


def _words(command: str) -> list[str]:
    """Split a command as a shell does; one with an open quote is a single word."""
    try:
        return shlex.split(command) or [command]
    except ValueError:
        return [command]


@contextmanager
def process_run(
    setup: ProcessSetup,
    handed: Mapping[str, FileContent] | None = None,
    where: Path | None = None,
    holds: Sequence[int] = (),
) -> Iterator[ProcessRun]:
    """Run programs in a folder; both end with the `with`.

    Args:
        handed: Files that the scenario hands to programs, by key.
        where: Folder to make it in; the system's for temporary files where None.
        holds: Descriptors that stay open until nothing of the run is left, however this process ends.

    Raises:
        ScenarioError: see `ProcessRun.begin`.
        OSError: see `ProcessRun.check_disk`.
    """
    root = Path(where or tempfile.gettempdir()).resolve() / f"vastflow-run-{secrets.token_hex(4)}"
    run = ProcessRun(root, setup, handed or {}, holds)
    try:
        run.begin()
        yield run
    finally:
        try:
            run.end()
            run.check_disk()
        finally:
            run.remove()
