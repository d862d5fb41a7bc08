"""Runtimes of containers: from a description to a command in the foreground, and one that removes what is left."""

import functools
import json
import os
import re
import shlex
import shutil
import subprocess
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import psutil

from vastflow.sim.model.container import Container
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.programs.cgroup import Cgroup
from vastflow.sim.scenario.programs.folders import BUBBLEWRAP, OUT
from vastflow.sim.scenario.programs.process import ProcessGroup, ProcessLog

TIMEOUT_S: Final = 60.0
"""Host time that a runtime has for an answer."""
_OWN: Final = frozenset({"proc", "dev", "sys", "tmp", "run", "config", "out", "channel"})
"""Folders that each container has of its own, whatever its root folder has there."""
_CAPABILITIES: Final = tuple(
    f"CAP_{name}" for name in ("CHOWN", "DAC_OVERRIDE", "FOWNER", "KILL", "NET_BIND_SERVICE", "SETGID", "SETUID")
)
_PLACES: Final = (
    "docker/{}",
    "system.slice/docker-{}.scope",
    "machine.slice/libpod-{}.scope",
    "libpod_parent/libpod-{}",
)
"""Control groups of Docker's and Podman's containers."""
_REMOVE_CGROUPS: Final = """\
for each in /sys/fs/cgroup/"$0" /sys/fs/cgroup/*/"$0"; do
    for _ in 1 2 3 4 5 6 7 8 9; do
        [ -d "$each" ] || continue 2
        kill -9 $(cat "$each/cgroup.procs") 2>/dev/null
        rmdir "$each" 2>/dev/null || sleep 0.1
    done
    exit 1
done
"""
_IN_CGROUP: Final = 'while [ "$1" != -- ]; do echo 0 >"$1/cgroup.procs" || exit; shift; done; shift; exec "$@"'


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
        """The log, which is whole if it has ended."""
        assert self.group is not None  # it has been started
        if not self.lives:
            self.group.log.complete.wait(0.2)
        return self.group.log

    def pids(self) -> set[int]:
        """Return the ids of its processes on this machine, and its client's."""
        return {*(self.cgroup.pids() if self.cgroup else ()), *([self.group.pid] if self.group and self.lives else ())}


class Runtime(ABC):
    """A runtime of containers.

    Attributes:
        fault: Pattern of its last line where a program could not be started, with the reason as its group.
    """

    name: str
    fault: ClassVar[str]

    @abstractmethod
    def works(self) -> bool:
        """Whether it can run containers here."""

    @abstractmethod
    def prepare(self, started: Started) -> None:
        """Set `client` of a container, and `cgroup` where it has one; `ScenarioError` if it can't be made."""

    @abstractmethod
    def removal(self, started: Started) -> Sequence[str]:
        """Return the command that ends and removes a container, whether it is there or not."""

    @abstractmethod
    def inside(self, started: Started, command: Sequence[str]) -> Sequence[str]:
        """Return a command that executes another one in a container; empty if it is not there yet."""

    def pid_in_network(self, started: Started) -> int | None:
        """Return a process with the container's network, if there is one yet."""
        return _in_own_network(started.cgroup.pids() if started.cgroup else ())

    def broken(self, started: Started) -> str:
        """Return why a container that failed breaks the run; empty if it failed by itself."""
        if started.cgroup and started.cgroup.killed():
            return _starved(started)
        found = re.search(self.fault, started.log.last_line())
        return found[1] if found else ""


class Engine(Runtime):
    """Docker, or Podman, whose command line is the same."""

    fault = r"^(?:\[FATAL tini \(\d+\)\]|ERROR \(catatonit:\d+\):) (.*)"

    def __init__(self, name: str) -> None:
        self.name = name

    def works(self) -> bool:
        if shutil.which(self.name) is not None:
            code, out, _ = _run([self.name, "info", "--format", "{{json .}}"])
            self._info: Mapping[str, Any] = json.loads(out) if code == 0 else {}
            return bool(self._info) and not self._info.get("ServerErrors")
        return False

    def prepare(self, started: Started) -> None:
        given = started.container
        network, ipc = "none", "private"
        if given.network == "run":
            other = started.neighbor
            network, ipc = (f"container:{other.id}",) * 2 if other else ("none", "shareable")
        id_file = started.folder / "id"
        options = ["--name", started.id, "--cidfile", str(id_file), "--label", "vastflow", "--pull", "never", "--init"]
        options += ["--workdir", OUT, "--network", network, "--ipc", ipc]
        if self.name == "docker":  # what it writes belongs to whoever runs the campaign, as Podman has it by itself
            options += ["--user", f"{os.getuid()}:{os.getgid()}"]
        for mount in given.mounts:
            readonly = "" if mount.writable else ",readonly"
            options += ["--mount", f'type=bind,"source={mount.source}","target={mount.target}"{readonly}']
        options += [f"--env={name}={value}" for name, value in given.environment.items()]
        for limit, known, words in (
            (given.memory, "MemoryLimit", [f"--memory={given.memory}b", f"--memory-swap={given.memory}b"]),
            (given.cpu, "CpuCfsQuota", [f"--cpus={given.cpu}"]),
            (given.processes, "PidsLimit", [f"--pids-limit={given.processes}"]),
        ):
            if limit is not None and not self._info.get(known, True):
                raise ScenarioError(f"container {started.name!r}: {self.name} has no {known} on this machine")
            options += [] if limit is None else words
        started.client = [self.name, "run", *options, given.image, *given.command]
        started.cgroup = Cgroup(_PLACES, id_file=id_file)

    def removal(self, started: Started) -> Sequence[str]:
        return [self.name, "rm", "--force", "--volumes", started.id]

    def inside(self, started: Started, command: Sequence[str]) -> Sequence[str]:
        return [self.name, "exec", started.id, *command]

    def broken(self, started: Started) -> str:
        state = "{{.State.Running}} {{.State.OOMKilled}} {{.State.Error}}"
        code, out, err = _run([self.name, "inspect", "--format", state, started.id])
        if code and "no such" in err.lower():  # it was never made
            said = _reason(started.log.read().decode(errors="replace"))
            missing = "no such image" in said.lower() or "image not known" in said
            return f"{said} `{self.name} pull {started.container.image}` may get it." if missing else said
        if code:
            return f"it no longer answers: {_reason(err)}"
        running, starved, error = f"{out.strip()}  ".split(" ", 2)
        if running == "true":
            return "it lost the container, which was still running"
        if starved == "true" or (started.container.memory and started.failure == "exited with code 137"):
            return _starved(started)
        return _reason(error) if error.strip() else super().broken(started)


class Runc(Runtime):
    """`runc` with the root folder's content, read-only; for root alone."""

    name = "runc"
    fault = r'runc run failed: (.*?)"?$'

    def works(self) -> bool:
        return shutil.which(self.name) is not None and os.geteuid() == 0

    def prepare(self, started: Started) -> None:
        started.cgroup = Cgroup((started.id,))
        (started.folder / "root").mkdir()
        (started.folder / "config.json").write_text(json.dumps(self._bundle(started)), encoding="utf-8")
        started.client = [*self._runc(started), "run", "--keep", "--bundle", str(started.folder), started.id]

    def removal(self, started: Started) -> Sequence[str]:
        known = shlex.join([*self._runc(started), "delete", "--force", started.id])
        return ["sh", "-c", f"{known}\n{_REMOVE_CGROUPS}", started.id]  # killed at its start, runc does not know it yet

    def inside(self, started: Started, command: Sequence[str]) -> Sequence[str]:
        return [*self._runc(started), "exec", started.id, *command]

    def _runc(self, started: Started) -> list[str]:
        return [self.name, "--root", str(started.folder / "state")]

    def _bundle(self, started: Started) -> dict[str, Any]:
        """Return the container as OCI's `config.json`, and make the links of its root folder.

        Its processes are not numbered anew: the first one of a process namespace would be deaf to SIGTERM.
        """
        given = started.container
        binds, links = _entries(Path(given.rootfs))
        for name, target in links.items():
            (started.folder / "root" / name).symlink_to(target)
        neighbor = started.neighbor and self.pid_in_network(started.neighbor)
        network = {"path": f"/proc/{neighbor}/ns/net"} if neighbor else {}
        limits: dict[str, Any] = {}
        if given.memory is not None:
            limits["memory"] = {"limit": given.memory, "swap": given.memory}
        if given.cpu is not None:
            limits["cpu"] = {"quota": max(1000, round(given.cpu * 100_000)), "period": 100_000}
        if given.processes is not None:
            limits["pids"] = {"limit": given.processes}
        return {
            "ociVersion": "1.0.2",
            "process": {
                "user": {"uid": 0, "gid": 0},
                "args": given.command,
                "env": [f"{name}={value}" for name, value in given.environment.items()],
                "cwd": OUT,
                "capabilities": dict.fromkeys(("bounding", "effective", "permitted"), _CAPABILITIES),
                "noNewPrivileges": True,
            },
            "root": {"path": "root", "readonly": True},
            "mounts": [
                {"destination": "/proc", "type": "proc", "source": "proc"},
                *({"destination": f"/{name}", "type": "tmpfs", "source": "tmpfs"} for name in ("dev", "tmp", "run")),
                *(_oci_mount(f"/{name}", str(folder)) for name, folder in {**binds, "sys": Path("/sys")}.items()),
                _oci_mount("/dev/shm", str(_shared_memory(started)), writable=True),
                *(_oci_mount(each.target, each.source, each.writable) for each in given.mounts),
            ],
            "linux": {
                "namespaces": [{"type": "mount"}, {"type": "ipc"}, {"type": "network", **network}],
                "cgroupsPath": f"/{started.id}",
                "resources": limits,
            },
        }


class Bubblewrap(Runtime):
    """bubblewrap with the root folder's content, read-only; limits by a control group where one can be made.

    It does not end with its parent, but by the run's guard: else SIGTERM would end it before its program could answer.
    """

    name = "bubblewrap"
    fault = "^bwrap: (.*)"

    def works(self) -> bool:
        command = [BUBBLEWRAP, "--unshare-pid", "--unshare-net", "--ro-bind", "/", "/", "--proc", "/proc", "true"]
        return shutil.which(BUBBLEWRAP) is not None and _run(command)[0] == 0

    def prepare(self, started: Started) -> None:
        given = started.container
        prefix: list[str] = []
        cgroup = Cgroup((started.id,))
        try:
            cgroup.make(given.memory, given.cpu, given.processes)
        except OSError:
            if given.cpu is not None or given.processes is not None:
                what = "bubblewrap can't limit cpu and processes here, where no control group can be made"
                raise ScenarioError(f"container {started.name!r}: {what}") from None
            prefix = [] if given.memory is None else ["prlimit", f"--as={given.memory}"]
        else:
            started.cgroup = cgroup
            prefix = ["sh", "-c", _IN_CGROUP, "sh", *map(str, cgroup.folders), "--"]
        neighbor = started.neighbor and self.pid_in_network(started.neighbor)
        network = ["nsenter", *_entered(neighbor, "net"), "--"] if neighbor else []
        binds, links = _entries(Path(given.rootfs))
        options = ["--unshare-pid", *([] if network else ["--unshare-net"]), "--cap-drop", "ALL", "--chdir", OUT]
        if os.geteuid() == 0:
            options += [word for name in _CAPABILITIES for word in ("--cap-add", name)]
        for name, folder in {**binds, "sys": Path("/sys")}.items():
            options += ["--ro-bind", str(folder), f"/{name}"]
        for name, target in links.items():
            options += ["--symlink", target, f"/{name}"]
        shared = str(_shared_memory(started))
        options += ["--proc", "/proc", "--dev", "/dev", "--bind", shared, "/dev/shm"]
        options += ["--tmpfs", "/tmp", "--tmpfs", "/run"]
        for mount in given.mounts:
            options += ["--bind" if mount.writable else "--ro-bind", mount.source, mount.target]
        environment = [f"{name}={value}" for name, value in given.environment.items()]
        inner = [str(shutil.which(BUBBLEWRAP)), *options, "--remount-ro", "/", "--", *given.command]
        started.client = [*prefix, *network, "env", "-i", *environment, *inner]

    def removal(self, started: Started) -> Sequence[str]:
        return ["sh", "-c", _REMOVE_CGROUPS, started.id]

    def inside(self, started: Started, command: Sequence[str]) -> Sequence[str]:
        pid = self.pid_in_network(started)
        return ["nsenter", *_entered(pid, "net", "mount", "pid"), "--", *command] if pid else []

    def pid_in_network(self, started: Started) -> int | None:
        if started.group is None or not started.lives:
            return None
        try:
            return _in_own_network(each.pid for each in psutil.Process(started.group.pid).children(recursive=True))
        except psutil.NoSuchProcess:
            return None


@functools.cache
def _runtime(name: str) -> Runtime:
    """Return a runtime, the same for all runs of a process."""
    return Runc() if name == Runc.name else Bubblewrap() if name == Bubblewrap.name else Engine(name)


@functools.cache
def _works(name: str) -> bool:
    return _runtime(name).works()


def chosen(name: str, containers: Sequence[Container]) -> Runtime:
    """Return the runtime of this name, or the first that works here where it is empty; `ScenarioError` if none does."""
    names = ("docker", "podman") if containers[0].image else (Runc.name, Bubblewrap.name)
    for each in [name] if name else names:
        if _works(each):
            return _runtime(each)
    raise ScenarioError(f"containers need {name or ' or '.join(names)}, which does not work on this machine")


def _run(command: Sequence[str]) -> tuple[int, str, str]:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return 1, "", f"{command[0]} did not answer within {TIMEOUT_S:g} s"
    except OSError as error:
        return 1, "", f"{command[0]}: {error.strerror}"
    return done.returncode, done.stdout, done.stderr


def _reason(text: str) -> str:
    """Return the last line that says something, without what a runtime puts before it."""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith(("See ", "Run "))]
    last = lines[-1] if lines else "no reason was given"
    for prefix in ("docker: ", "Error response from daemon: ", "Error: "):
        last = last.removeprefix(prefix)
    return last[:400]


def _starved(started: Started) -> str:
    limit = started.container.memory
    allowed = f"its memory of {limit >> 20} MiB was" if limit else "the machine's memory was"
    return f"{allowed} full, and the kernel killed a process of it"


def _entries(rootfs: Path) -> tuple[dict[str, Path], dict[str, str]]:
    """Return what a root folder has by its name: files and folders, and the targets of links."""
    try:
        entries = [entry for entry in os.scandir(rootfs) if entry.name not in _OWN]
    except OSError as error:
        raise ScenarioError(f"rootfs {str(rootfs)!r}: {error.strerror}") from None
    links = {entry.name: os.readlink(entry.path) for entry in entries if entry.is_symlink()}
    return {entry.name: Path(entry.path) for entry in entries if entry.name not in links}, links


def _oci_mount(target: str, source: str, writable: bool = False) -> dict[str, Any]:
    return {"destination": target, "type": "bind", "source": source, "options": ["rbind", "rw" if writable else "rro"]}


def _shared_memory(started: Started) -> Path:
    """Return the folder that containers of a network share as `/dev/shm`."""
    if started.container.network == "run":
        return started.folder.parent.parent / "shm"
    (own := started.folder / "shm").mkdir(exist_ok=True)
    return own


def _in_own_network(pids: Iterable[int]) -> int | None:
    """Return the first process that is not in this process' network."""
    own = os.readlink("/proc/self/ns/net")
    for pid in pids:
        try:
            if os.readlink(f"/proc/{pid}/ns/net") != own:
                return pid
        except PermissionError:  # another user's, which is a container's
            return pid
        except OSError:  # it has just ended
            continue
    return None


def _entered(pid: int, *namespaces: str) -> list[str]:
    """Return options of nsenter for namespaces of a process, and the user namespace that they belong to."""
    users = Path(f"/proc/{pid}/ns/user")
    own = [] if users.samefile("/proc/self/ns/user") else ["--preserve-credentials", f"--user={users}"]
    kinds = {"net": "net", "mount": "mnt", "pid": "pid"}
    return [*own, *(f"--{each}=/proc/{pid}/ns/{kinds[each]}" for each in namespaces)]
