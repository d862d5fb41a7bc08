"""Runtimes of containers: from a description to a command in the foreground, and one that removes what is left."""

import functools
import json
import os
import re
import shutil
import subprocess
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

from vastflow.sim.model.container import Container, Mount
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.programs.cgroup import Cgroup
from vastflow.sim.scenario.programs.folders import BUBBLEWRAP, OUT
from vastflow.sim.scenario.programs.guard import marked
from vastflow.sim.scenario.programs.process import ProcessGroup

TIMEOUT_S: Final = 60.0
"""Host time that a runtime has for an answer."""
_OWN: Final = frozenset({"proc", "dev", "sys", "tmp", "run", "config", "out", "channel"})
"""Folders that each container has of its own, whatever its root folder has there."""
_CAPABILITIES: Final = tuple(
    f"CAP_{name}" for name in ("CHOWN", "DAC_OVERRIDE", "FOWNER", "KILL", "NET_BIND_SERVICE", "SETGID", "SETUID")
)
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
_NOT_STARTED: Final = r"(?:^\[FATAL tini \(\d+\)\]|^ERROR \(catatonit:\d+\):|runc run failed:|^bwrap:) (.*?)\"?$"
"""The last line of a runtime whose program could not be started, with the reason as its group."""
_IN_CGROUP: Final = 'while [ "$1" != -- ]; do echo 0 >"$1/cgroup.procs" || exit; shift; done; shift; exec "$@"'


@dataclass
class Started:
    """A container of a run.

    Attributes:
        id: Its name at the runtime, unique on this machine.
        container: What it is, with the variables, mounts, and the command of this start.
        folder: Folder of its own for the runtime's files.
        neighbor: A living one whose network it shares.
        mark: Mark of its processes, see `vastflow.sim.scenario.programs.guard`.
        client: Command that runs it in the foreground.
        group: Process group of `client`.
        cgroup: Its control group; None where it has none.
    """

    name: str
    id: str
    container: Container
    folder: Path
    mark: str
    neighbor: "Started | None"
    client: Sequence[str] = ()
    group: ProcessGroup | None = None
    cgroup: Cgroup | None = None
    began_s: float = field(default_factory=time.monotonic)
    is_examined: bool = False

    @property
    def lives(self) -> bool:
        return self.group is not None and self.group.failure is None

    def pid_inside(self) -> int | None:
        """Return a process of the container, other than its client, if there is one yet."""
        own, client = os.readlink("/proc/self/ns/net"), self.group.pid if self.group else 0
        for pid in marked(self.mark) if self.lives else ():
            with suppress(OSError):  # it has just ended
                if pid != client and os.readlink(f"/proc/{pid}/ns/net") != own:
                    return pid
        return None


class Engine:
    """Docker, or Podman, whose command line is the same."""

    def __init__(self, name: str) -> None:
        self.name = name

    def works(self) -> bool:
        """Whether it can run containers here."""
        code, out, _ = run_command([self.name, "info", "--format", "{{json .}}"])
        self._info: Mapping[str, Any] = json.loads(out) if code == 0 else {}
        return bool(self._info) and not self._info.get("ServerErrors")

    def prepare(self, started: Started) -> None:
        """Set `client` of a container, and `cgroup` where it has one; `ScenarioError` if it can't be made."""
        given, other = started.container, started.neighbor and f"container:{started.neighbor.id}"
        ipc = other or ("shareable" if given.network == "run" else "private")
        options = ["--name", started.id, "--label", "vastflow", "--pull", "never", "--init"]
        options += ["--workdir", OUT, "--network", other or "none", "--ipc", ipc]
        if self.name == "docker":  # what it writes belongs to whoever runs the campaign, as Podman has it by itself
            options += ["--user", f"{os.getuid()}:{os.getgid()}"]
        for mount in given.mounts:
            readonly = "" if mount.writable else ",readonly"
            options += ["--mount", f'type=bind,"source={mount.source}","target={mount.target}"{readonly}']
        options += [f"--env={name}={value}" for name, value in given.env.items()]
        for limit, known, words in (
            (given.memory, "MemoryLimit", [f"--memory={given.memory}b", f"--memory-swap={given.memory}b"]),
            (given.cpu, "CpuCfsQuota", [f"--cpus={given.cpu}"]),
            (given.processes, "PidsLimit", [f"--pids-limit={given.processes}"]),
        ):
            if limit is not None and not self._info.get(known, True):
                raise ScenarioError(f"container {started.name!r}: {self.name} has no {known} on this machine")
            options += [] if limit is None else words
        started.client = [self.name, "run", *options, given.image, *given.command]

    def removal(self, started: Started) -> Sequence[str]:
        """Return the command that ends and removes a container, whether it is there or not."""
        return [self.name, "rm", "--force", "--volumes", started.id]

    def inside(self, started: Started, command: Sequence[str]) -> Sequence[str]:
        """Return a command that executes another one in a container; empty if it is not there yet."""
        return [self.name, "exec", started.id, *command]

    def broken(self, started: Started, group: ProcessGroup) -> str:
        """Return why a container whose client failed breaks the run; empty if it failed by itself."""
        group.log.complete.wait(0.2)
        state = "{{.State.Running}} {{.State.OOMKilled}} {{.State.Error}}"
        code, out, err = run_command([self.name, "inspect", "--format", state, started.id])
        if code and "no such" in err.lower():  # it was never made
            return _reason(group.log.read().decode(errors="replace"))
        if code:
            return f"it no longer answers: {_reason(err)}"
        running, starved, error = f"{out.strip()}  ".split(" ", 2)
        if running == "true":
            return "it lost the container, which was still running"
        if starved == "true" or (started.container.memory and group.failure == "exited with code 137"):
            return _starved(started)
        return _reason(error) if error.strip() else _broken(started, group)


class Bundler(ABC):
    """A runtime of containers from a root folder's content, read-only; its methods are `Engine`'s."""

    name: str

    @abstractmethod
    def works(self) -> bool: ...

    def prepare(self, started: Started) -> None:
        given = started.container
        started.cgroup, limits = Cgroup(started.id), []
        try:
            started.cgroup.make(given.memory, given.cpu, given.processes)
        except OSError:
            if given.cpu is not None or given.processes is not None:
                what = f"{self.name} can't limit cpu and processes here, where no control group can be made"
                raise ScenarioError(f"container {started.name!r}: {what}") from None
            started.cgroup, limits = None, [] if given.memory is None else ["prlimit", f"--as={given.memory}"]
        neighbor = started.neighbor and started.neighbor.pid_inside()
        network = ["nsenter", *_entered(neighbor, "net"), "--"] if neighbor else []
        root = Path(given.rootfs).resolve()
        try:
            entries = [(name, (root / name).resolve()) for name in os.listdir(root) if name not in _OWN]
        except OSError as error:
            raise ScenarioError(f"rootfs {given.rootfs!r}: {error.strerror}") from None
        own = [Mount(str(at), f"/{name}") for name, at in entries if at.exists() and at.is_relative_to(root)]
        shared = started.folder if given.network == "none" else started.folder.parent.parent
        (shm := shared / "shm").mkdir(exist_ok=True)
        shm.chmod(0o1777)
        mounts = [*own, Mount("/sys", "/sys"), Mount(str(shm), "/dev/shm", writable=True), *given.mounts]
        started.client = [*limits, *network, *self.command(started, mounts, not neighbor)]

    @abstractmethod
    def command(self, started: Started, mounts: Iterable[Mount], isolated: bool) -> list[str]:
        """Return the command that runs a container in the foreground; `isolated` in a network of its own."""

    def removal(self, started: Started) -> Sequence[str]:
        return ["sh", "-c", _REMOVE_CGROUPS, started.id]

    def inside(self, started: Started, command: Sequence[str]) -> Sequence[str]:
        pid = started.pid_inside()
        return ["nsenter", *_entered(pid, "net", "mnt", "pid"), "--", *command] if pid else []

    def broken(self, started: Started, group: ProcessGroup) -> str:
        return _broken(started, group)


class Runc(Bundler):
    """`runc`; for root alone.

    Its processes are not numbered anew: the first one of a process namespace would be deaf to SIGTERM.
    """

    name = "runc"

    def works(self) -> bool:
        return shutil.which(self.name) is not None and os.geteuid() == 0

    def command(self, started: Started, mounts: Iterable[Mount], isolated: bool) -> list[str]:
        given = started.container
        (started.folder / "root").mkdir()
        fresh = {"proc": "proc", "dev": "tmpfs", "tmp": "tmpfs", "run": "tmpfs"}
        options = {False: ["rbind", "rro"], True: ["rbind", "rw"]}
        seen: list[Any] = [{"destination": f"/{name}", "type": kind, "source": kind} for name, kind in fresh.items()]
        for each in mounts:
            how = options[each.writable]
            seen.append({"destination": each.target, "type": "bind", "source": each.source, "options": how})
        namespaces = [{"type": kind} for kind in ("mount", "ipc", *(["network"] if isolated else []))]
        bundle = {
            "ociVersion": "1.0.2",
            "process": {
                "args": given.command,
                "env": [f"{name}={value}" for name, value in given.env.items()],
                "cwd": OUT,
                "user": {},
                "capabilities": dict.fromkeys(("bounding", "effective", "permitted"), _CAPABILITIES),
                "noNewPrivileges": True,
            },
            "root": {"path": "root", "readonly": True},
            "mounts": seen,
            "linux": {"namespaces": namespaces, "cgroupsPath": f"/{started.id}"},
        }
        (started.folder / "config.json").write_text(json.dumps(bundle), encoding="utf-8")
        state = str(started.folder / "state")
        return [self.name, "--root", state, "run", "--keep", "--bundle", str(started.folder), started.id]


class Bubblewrap(Bundler):
    """bubblewrap; limits by a control group where one can be made.

    It does not end with its parent, but by the run's guard: else SIGTERM would end it before its program could answer.
    """

    name = "bubblewrap"

    def works(self) -> bool:
        command = [BUBBLEWRAP, "--unshare-pid", "--unshare-net", "--ro-bind", "/", "/", "--proc", "/proc", "true"]
        return shutil.which(BUBBLEWRAP) is not None and run_command(command)[0] == 0

    def command(self, started: Started, mounts: Iterable[Mount], isolated: bool) -> list[str]:
        given, cgroup = started.container, started.cgroup
        prefix = ["sh", "-c", _IN_CGROUP, "sh", *map(str, cgroup.folders), "--"] if cgroup else []
        options = ["--unshare-pid", *(["--unshare-net"] if isolated else []), "--cap-drop", "ALL", "--chdir", OUT]
        if os.geteuid() == 0:
            options += [word for name in _CAPABILITIES for word in ("--cap-add", name)]
        options += ["--proc", "/proc", "--dev", "/dev", "--tmpfs", "/tmp", "--tmpfs", "/run"]
        for mount in mounts:
            options += ["--bind" if mount.writable else "--ro-bind", mount.source, mount.target]
        environment = [f"{name}={value}" for name, value in given.env.items()]
        inner = [str(shutil.which(BUBBLEWRAP)), *options, "--remount-ro", "/", "--", *given.command]
        return [*prefix, "env", "-i", *environment, *inner]


Runtime: TypeAlias = Engine | Bundler


@functools.cache
def _working(name: str) -> Runtime | None:
    """Return a runtime, the same for all runs of a process; None if it does not work here."""
    made: Runtime = Runc() if name == Runc.name else Bubblewrap() if name == Bubblewrap.name else Engine(name)
    return made if made.works() else None


def chosen(name: str, containers: Sequence[Container]) -> Runtime:
    """Return the runtime of this name, or the first that works here where it is empty; `ScenarioError` if none does."""
    names = ("docker", "podman") if containers[0].image else (Runc.name, Bubblewrap.name)
    for each in [name] if name else names:
        if found := _working(each):
            return found
    raise ScenarioError(f"containers need {name or ' or '.join(names)}, which does not work on this machine")


def run_command(command: Sequence[str], timeout_s: float = TIMEOUT_S) -> tuple[int, str, str]:
    """Return exit code, output, and errors of a command, in words where it can't be executed or takes longer."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False, timeout=timeout_s)
    except subprocess.TimeoutExpired:
        return 1, "", f"{command[0]} did not answer within {timeout_s:g} s"
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


def _broken(started: Started, group: ProcessGroup) -> str:
    if started.cgroup and started.cgroup.killed():
        return _starved(started)
    if group.failure and group.failure.startswith("was ended by"):  # else a signal of the program is an exit code of it
        return f"its client {group.failure}"
    found = re.search(_NOT_STARTED, group.log.last_line())
    return found[1] if found else ""


def _starved(started: Started) -> str:
    limit = started.container.memory
    allowed = f"its memory of {limit >> 20} MiB was" if limit else "the machine's memory was"
    return f"{allowed} full, and the kernel killed a process of it"


def _entered(pid: int, *kinds: str) -> list[str]:
    """Return options of nsenter for namespaces of a process, and the user namespace that they belong to."""
    users = Path(f"/proc/{pid}/ns/user")
    own = [] if users.samefile("/proc/self/ns/user") else ["--preserve-credentials", f"--user={users}"]
    return [*own, *(f"--{'mount' if kind == 'mnt' else kind}=/proc/{pid}/ns/{kind}" for kind in kinds)]
