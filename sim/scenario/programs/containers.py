"""Containers of a run: what they are given, their start in order, their health, and why one broke the run."""

import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs.cgroup import Cgroup
from vastflow.sim.scenario.programs.folders import CONFIG, OUT, RunFolders
from vastflow.sim.scenario.programs.guard import VARIABLE
from vastflow.sim.scenario.programs.process import ProcessGroup, ProcessLog

if TYPE_CHECKING:
    from vastflow.sim.scenario.programs.run import ProcessRun

MAIN: Final = "main"
"""The container in which the scenario's programs are started, each in one of its own."""
CHANNEL: Final = "/channel"
"""Folder for UNIX sockets between this machine and containers, as they see it."""
PATH: Final = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_POLL_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class Mount:
    """A folder or file of this machine, as a container sees it."""

    source: str
    target: str
    writable: bool = False


@dataclass(frozen=True, slots=True)
class Container:
    """A container of a campaign's runs, see `execution.containers`.

    Attributes:
        image: Image of Docker or Podman; empty where there is a `rootfs`.
        rootfs: Root folder on this machine, which it may only read.
        command: Program and arguments; empty for the image's own.
        cpu: Cores that it may use, at most; None for all.
        memory: Its greatest memory (bytes); None for all.
        processes: Greatest number of its processes and threads; None for any.
        network: `none`, or `run` for a loopback that containers of the run share.
        after: Containers that have to be healthy before.
        health: `log` (a text that it prints), `port` (TCP, listened on), or `command` (exits with 0), and its value; may be empty.
        within_s: Host time until it has to be healthy.
    """

    image: str = ""
    rootfs: str = ""
    command: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    mounts: tuple[Mount, ...] = ()
    cpu: float | None = None
    memory: int | None = None
    processes: int | None = None
    network: Literal["none", "run"] = "run"
    after: tuple[str, ...] = ()
    health: Mapping[str, Any] = field(default_factory=dict)
    within_s: float = 30.0


def container_of(content: Mapping[str, Any]) -> Container:
    """Return the container that a `ProcessSetup` describes by `content`."""
    lists = {name: tuple(content[name]) for name in ("command", "after") if name in content}
    return Container(**{**content, **lists, "mounts": tuple(Mount(**each) for each in content.get("mounts", ()))})


@dataclass
class Started:
    """A container of a run.

    Attributes:
        id: Its name at the runtime, unique on this machine.
        container: What it is, with the variables, mounts, and the command of this start.
        folder: Folder of its own for the runtime's files.
        neighbor: A living one whose network it shares.
        client: Command that runs it in the foreground.
        group: Process group of `client`.
        cgroup: Its control group; None where it has none.
    """

    name: str
    id: str
    container: Container
    folder: Path
    neighbor: "Started | None"
    client: Sequence[str] = ()
    group: ProcessGroup | None = None
    cgroup: Cgroup | None = None
    began_s: float = field(default_factory=time.monotonic)
    is_examined: bool = False

    @property
    def lives(self) -> bool:
        return self.group is not None and self.group.failure is None

    @property
    def failure(self) -> str | None:
        return self.group.failure if self.group else None

    @property
    def log(self) -> ProcessLog:
        """What it printed, which is whole if it has ended."""
        assert self.group is not None  # it has been started
        if not self.lives:
            self.group.log.complete.wait(0.2)
        return self.group.log

    def pids(self) -> set[int]:
        """Return the ids of its processes on this machine, and its client's."""
        return {*(self.cgroup.pids() if self.cgroup else ()), *([self.group.pid] if self.group and self.lives else ())}


class RunContainers:
    """The containers of one run."""

    def __init__(self, run: "ProcessRun", setup: ProcessSetup) -> None:
        """Choose the runtime; nothing is started yet.

        Raises:
            ScenarioError: none works here.
        """
        from vastflow.sim.scenario.programs.runtimes import chosen  # it imports this module

        self.containers = {name: container_of(content) for name, content in setup.containers.items()}
        self._run = run
        self._environment = setup.environment
        self._started: list[Started] = []
        self._runtime = chosen(setup.container_runtime, [*self.containers.values()])
        for folder in (run.folders.out.parent / "channel", run.folders.out.parent / "shm"):
            folder.mkdir()
        (run.folders.out.parent / "shm").chmod(0o1777)

    @property
    def has_main(self) -> bool:
        return MAIN in self.containers

    @property
    def note(self) -> str:
        names = dict.fromkeys(started.name for started in self._started)
        return f"containers run by {self._runtime.name}: {', '.join(names)}" if names else ""

    def begin(self) -> None:
        """Start those with a command, or an image's own, in order, and wait until they are healthy.

        Raises:
            ScenarioError: one can't be started, ends before it is healthy, or is not in time.
        """
        waiting = [
            name for name, container in self.containers.items() if name != MAIN or container.command or container.health
        ]
        begun: dict[str, Started] = {}
        while waiting or begun:
            ready = [name for name in waiting if not ({*self.containers[name].after} & {*waiting, *begun})]
            for name in ready:
                self._run.start(self.containers[name].command, name, container=name)
                begun[name] = self._started[-1]
                waiting.remove(name)
            for name in [name for name, started in begun.items() if self._is_healthy(started)]:
                del begun[name]
            if begun and not ready:
                time.sleep(_POLL_S)

    def launched(self, name: str, command: Sequence[str], mark: str) -> Started | None:
        """Prepare a container for `command`, whose `client` is then to be started; None if there is none of this name.

        Raises:
            ScenarioError: the runtime can't make it; such as for an image that is not there.
        """
        if (given := self.containers.get(name)) is None:
            return None
        folders = self._run.folders
        base = {} if given.image else {"PATH": PATH, "HOME": "/tmp"}  # in the container
        shared = self._run.environment if name == MAIN else self._environment
        environment = {**base, **shared, **given.environment, VARIABLE: mark}
        mounts = (*mounts_of(folders), *(_placed(mount, folders) for mount in given.mounts))
        number = len(self._started)
        (folder := folders.out.parent / "containers" / str(number)).mkdir(parents=True)
        in_network = (each for each in self._started if each.lives and each.container.network == "run")
        started = Started(
            name,
            "-".join(["vastflow", *mark.split(".")[-3:-1], name]),
            replace(given, command=tuple(command), environment=environment, mounts=mounts),
            folder,
            next(in_network, None) if given.network == "run" else None,
        )
        self._started.append(started)
        self._run.at_end(self._runtime.removal(started))
        self._runtime.prepare(started)
        return started

    def cgroups(self) -> Iterator[Started]:
        """Yield the containers with a control group."""
        return (started for started in tuple(self._started) if started.cgroup is not None)

    def check(self) -> None:
        """Raise `ScenarioError` if a container ended by a limit, by its runtime, or was never started."""
        for started in self._started:
            group = started.group
            if group is None or group.failure is None or started.is_examined:
                continue
            started.is_examined = True
            if group.failure and not group.is_stopped and (why := self._runtime.broken(started)):
                raise ScenarioError(f"container {started.name!r} by {self._runtime.name}: {why}")

    def _is_healthy(self, started: Started) -> bool:
        container, group = started.container, started.group
        assert group is not None  # it has been started
        ((kind, value),) = container.health.items() or [("", "")]
        if (failure := group.failure) is not None:
            self.check()
            if kind or failure:
                ended = group.with_last_line(failure or "exited with code 0")
                raise ScenarioError(f"container {started.name!r} {ended}, before it was healthy")
            return True
        match kind:
            case "log":
                done = str(value).encode() in group.log.read()
            case "port":
                pid = self._runtime.pid_in_network(started)
                done = pid is not None and is_listened_on(int(value), pid)
            case "command":
                done = self._answers(self._runtime.inside(started, value))
            case _:
                done = self._runtime.pid_in_network(started) is not None
        if not done and time.monotonic() - started.began_s > container.within_s:
            wanted = {"log": f"printed {value!r}", "port": f"listened on port {value}"}
            what = wanted.get(kind, "passed its health command" if kind else "started")
            raise ScenarioError(
                group.with_last_line(f"container {started.name!r} has not {what} within {container.within_s:g} s")
            )
        return done

    def _answers(self, command: Sequence[str]) -> bool:
        if not command:
            return False
        try:
            return subprocess.run(command, capture_output=True, check=False, timeout=10.0).returncode == 0
        except subprocess.TimeoutExpired:
            return False


def mounts_of(folders: RunFolders) -> tuple[Mount, ...]:
    """Return what each container of a run sees of it."""
    channel = Mount(str(folders.out.parent / "channel"), CHANNEL, writable=True)
    return (Mount(str(folders.config), CONFIG), Mount(str(folders.out), OUT, writable=True), channel)


def is_listened_on(port: int, pid: int) -> bool:
    """Whether somebody listens on a TCP port in the network of a process."""
    for name in ("tcp", "tcp6"):
        try:
            lines = Path(f"/proc/{pid}/net/{name}").read_text(encoding="ascii").split("\n")[1:]
        except OSError:  # it has just ended
            continue
        if any(line.split()[1].endswith(f":{port:04X}") and line.split()[3] == "0A" for line in lines if line):
            return True
    return False


def _placed(mount: Mount, folders: RunFolders) -> Mount:
    """Return a mount with the path of its source on this machine; relative ones are run files."""
    source = mount.source if mount.source.startswith("/") else f"{CONFIG}/{mount.source}"
    path = folders.path(source) if source.startswith((f"{CONFIG}/", f"{OUT}/")) else Path(source)
    if not path.exists():
        hint = "" if mount.source.startswith("/") else ", and no file that execution.run_files matches"
        raise ScenarioError(f"mount {mount.source!r}: there is no such file or folder{hint}")
    return Mount(str(path), mount.target, mount.writable)
