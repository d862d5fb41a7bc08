"""Containers of a run: what they are given, their start in order, their health, and why one broke the run."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from vastflow.sim.model.container import CHECKS, MAIN, Mount, container_of
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs.cgroup import Cgroup
from vastflow.sim.scenario.programs.folders import CONFIG, OUT, RunFolders
from vastflow.sim.scenario.programs.guard import VARIABLE
from vastflow.sim.scenario.programs.runtimes import Started, chosen, run_command

CHANNEL: Final = "/channel"
"""Folder for UNIX sockets between this machine and containers, as they see it."""
PATH: Final = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_POLL_S: Final = 0.05


class RunContainers:
    """The containers of one run."""

    def __init__(self, folders: RunFolders, setup: ProcessSetup, at_end: Callable[[Sequence[str]], None]) -> None:
        """Choose the runtime; nothing is started yet. `at_end` has a command executed after the run.

        Raises:
            ScenarioError: none works here.
        """
        self.containers = {name: container_of(content) for name, content in setup.containers.items()}
        self._folders = folders
        self._environment = setup.environment
        self._at_end = at_end
        self._started: list[Started] = []
        self._runtime = chosen(setup.container_runtime, [*self.containers.values()])
        self._channel = folders.out.parent / "channel"
        self._channel.mkdir()

    @property
    def note(self) -> str:
        names = dict.fromkeys(started.name for started in self._started)
        return f"containers run by {self._runtime.name}: {', '.join(names)}" if names else ""

    def begin(self, start: Callable[[Sequence[str], str], object]) -> None:
        """Have those with a command, or an image's own, started in order by `start`, and wait until they are healthy.

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
                start(self.containers[name].command, name)
                begun[name] = self._started[-1]
                waiting.remove(name)
            for name in [name for name, started in begun.items() if self._is_healthy(started)]:
                del begun[name]
            if begun and not ready:
                time.sleep(_POLL_S)

    def launched(self, name: str, command: Sequence[str], mark: str, of_main: Mapping[str, str]) -> Started | None:
        """Prepare a container for `command`, whose `client` is then to be started; None if there is none of this name.

        Raises:
            ScenarioError: the runtime can't make it; such as for an image that is not there.
        """
        if (given := self.containers.get(name)) is None:
            return None
        folders = self._folders
        base = {} if given.image else {"PATH": PATH, "HOME": "/tmp"}  # in the container
        shared = of_main if name == MAIN else self._environment
        own = {**folders.mounts, CHANNEL: self._channel}
        mounts = [Mount(str(folder), target, target != CONFIG) for target, folder in own.items()]
        mounts += [_placed(mount, folders) for mount in given.mounts]
        (folder := folders.out.parent / "containers" / str(len(self._started))).mkdir(parents=True)
        in_network = (each for each in self._started if each.lives and each.container.network == "run")
        started = Started(
            name,
            "-".join(["vastflow", *mark.split(".")[-3:-1], name]),
            replace(
                given, command=tuple(command), env={**base, **shared, **given.env, VARIABLE: mark}, mounts=tuple(mounts)
            ),
            folder,
            mark,
            next(in_network, None) if given.network == "run" else None,
        )
        self._started.append(started)
        self._at_end(self._runtime.removal(started))
        self._runtime.prepare(started)
        return started

    def cgroups(self) -> Iterator[tuple[Cgroup, int]]:
        """Yield the control group of each container that has one, and the id of its client's process."""
        for started in tuple(self._started):
            if started.cgroup is None and (pid := started.pid_inside()) is not None:  # an engine made it
                started.cgroup = Cgroup.of(pid)
            if started.cgroup is not None and started.group is not None:
                yield started.cgroup, started.group.pid

    def check(self) -> None:
        """Raise `ScenarioError` if a container ended by a limit, by its runtime, or was never started."""
        for started in self._started:
            group = started.group
            if group is None or group.failure is None or started.is_examined:
                continue
            started.is_examined = True
            if group.failure and not group.is_stopped and (why := self._runtime.broken(started, group)):
                raise ScenarioError(f"container {started.name!r} by {self._runtime.name}: {why}")

    def _is_healthy(self, started: Started) -> bool:
        container, group = started.container, started.group
        assert group is not None  # it has been started
        kind, value = next(((each, container.health[each]) for each in CHECKS if each in container.health), ("", ""))
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
                pid = started.pid_inside()
                done = pid is not None and is_listened_on(int(value), pid)
            case "command":
                command = self._runtime.inside(started, value)
                done = bool(command) and run_command(command, 10.0)[0] == 0
            case _:
                done = started.pid_inside() is not None
        within_s = container.health.get("timeout", 30.0)
        if not done and time.monotonic() - started.began_s > within_s:
            wanted = {"": "started", "log": f"printed {value!r}", "port": f"listened on port {value}"}
            what = f"has not {wanted.get(kind, 'passed its health command')} within {within_s:g} s"
            raise ScenarioError(group.with_last_line(f"container {started.name!r} {what}"))
        return done


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
