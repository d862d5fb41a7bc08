"""Control groups of containers: their limits, and what their processes use; versions 1 and 2 of the kernel's interface."""

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

ROOT: Final = Path("/sys/fs/cgroup")
_PERIOD_US: Final = 100_000


@dataclass(frozen=True)
class Cgroup:
    """A control group.

    Attributes:
        name: Its path below the root of each controller, or below the only root of version 2.
    """

    name: str
    root: Path = field(default_factory=lambda: ROOT)

    @classmethod
    def of(cls, pid: int) -> "Cgroup | None":
        """Return the one of a process; None if it is this process' own, or the process has ended."""
        try:
            name, own = (_name(Path(f"/proc/{each}/cgroup").read_text("utf-8")) for each in (pid, "self"))
        except OSError:
            return None
        return None if name == own else cls(name)

    def folder(self, controller: str) -> Path:
        """Return its folder for a controller such as `memory`."""
        return (self.root if self._is_unified else self.root / controller) / self.name

    @property
    def folders(self) -> tuple[Path, ...]:
        """All its folders that limit or measure something."""
        return tuple(dict.fromkeys(self.folder(each) for each in ("memory", "cpu", "cpuacct", "pids")))

    def make(self, memory: int | None, cpu: float | None, processes: int | None) -> None:
        """Make it with limits: bytes, cores, and a number of processes; raises OSError where this user may not."""
        with suppress(OSError):
            (self.root / "cgroup.subtree_control").write_text("+memory +cpu +pids", encoding="ascii")
        for folder in self.folders:
            folder.mkdir(exist_ok=True)  # where `cpu` and `cpuacct` are one
        quota = cpu and max(1000, round(cpu * _PERIOD_US))
        for controller, first, second, value in (
            ("memory", "memory.limit_in_bytes", "memory.max", memory),
            ("cpu", "cpu.cfs_quota_us", "cpu.max", quota),
            ("pids", "pids.max", "pids.max", processes),
        ):
            if value is not None:
                period = f" {_PERIOD_US}" if self._is_unified and controller == "cpu" else ""
                (self.folder(controller) / (second if self._is_unified else first)).write_text(f"{value}{period}")
        if memory is not None:  # else it would swap where the machine can
            for name, most in (("memory.swap.max", 0), ("memory.memsw.limit_in_bytes", memory)):
                with suppress(OSError):
                    (self.folder("memory") / name).write_text(str(most), encoding="ascii")

    def pids(self) -> set[int]:
        """Return the ids of its processes on this machine; none where it is gone."""
        with suppress(OSError):
            return {int(line) for line in (self.folder("memory") / "cgroup.procs").read_text("ascii").split()}
        return set()

    def usage(self) -> tuple[float, int] | None:
        """Return processor time (s) and resident memory (bytes) of all its processes; None where it is gone."""
        try:
            if self._is_unified:
                cpu_s = self._value("cpu", "cpu.stat", "usage_usec") / 1e6
                return cpu_s, self._value("memory", "memory.stat", "anon")
            cpu_ns = int((self.folder("cpuacct") / "cpuacct.usage").read_text("ascii"))
            return cpu_ns / 1e9, self._value("memory", "memory.stat", "total_rss")
        except OSError:
            return None

    def killed(self) -> int:
        """Return how many of its processes the kernel killed for want of memory."""
        try:
            return self._value("memory", "memory.events" if self._is_unified else "memory.oom_control", "oom_kill")
        except OSError:
            return 0

    @property
    def _is_unified(self) -> bool:
        return (self.root / "cgroup.controllers").exists()

    def _value(self, controller: str, name: str, key: str) -> int:
        lines = (self.folder(controller) / name).read_text("ascii").splitlines()
        return next((int(line.split()[1]) for line in lines if line.split()[0] == key), 0)


def _name(text: str) -> str:
    """Return the path in a process' list of control groups: that of version 1's `memory`, or of version 2."""
    names = {
        each: path[1:]
        for _, kinds, path in (line.split(":", 2) for line in text.splitlines())
        for each in kinds.split(",")
    }
    return names.get("memory") or names.get("", "")
