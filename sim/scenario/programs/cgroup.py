"""Control groups of containers: their limits, and what their processes use; versions 1 and 2 of the kernel's interface."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

ROOT: Final = Path("/sys/fs/cgroup")
_PERIOD_US: Final = 100_000


@dataclass(frozen=True)
class Cgroup:
    """A control group below the root of each controller, or below the only root of version 2.

    Attributes:
        paths: Where it may be; the first that is there counts.
        id_file: File with what stands for `{}` in `paths`, once it is there.
    """

    paths: tuple[str, ...]
    root: Path = field(default_factory=lambda: ROOT)
    id_file: Path | None = None

    def folder(self, controller: str) -> Path:
        """Return its folder for a controller such as `memory`."""
        root = self.root if self._is_unified else self.root / controller
        name = ""
        if self.id_file is not None:
            with suppress(OSError):
                name = self.id_file.read_text("ascii")
        places = [root / path.format(name) for path in self.paths]
        return (
            next((place for place in places if place.is_dir()), places[0]) if name or not self.id_file else root / "-"
        )

    @property
    def folders(self) -> tuple[Path, ...]:
        """All its folders that limit or measure something."""
        return tuple(dict.fromkeys(self.folder(each) for each in ("memory", "cpu", "cpuacct", "pids")))

    def make(self, memory: int | None, cpu: float | None, processes: int | None) -> None:
        """Make it with limits: bytes, cores, and a number of processes; raises OSError where this user may not."""
        quota = None if cpu is None else max(1000, round(cpu * _PERIOD_US))
        for folder in self.folders:
            folder.mkdir(exist_ok=True)  # where `cpu` and `cpuacct` are one
        limits: Iterable[tuple[str, str, int | str | None]]
        if self._is_unified:
            limits = [
                ("memory", "memory.max", memory),
                ("cpu", "cpu.max", quota and f"{quota} {_PERIOD_US}"),
                ("pids", "pids.max", processes),
            ]
        else:
            limits = [
                ("memory", "memory.limit_in_bytes", memory),
                ("cpu", "cpu.cfs_quota_us", quota),
                ("pids", "pids.max", processes),
            ]
        for controller, name, value in limits:
            if value is not None:
                (self.folder(controller) / name).write_text(str(value), encoding="ascii")
        if memory is not None:  # else it would swap where the machine can
            for name, value in (("memory.swap.max", 0), ("memory.memsw.limit_in_bytes", memory)):
                with suppress(OSError):
                    (self.folder("memory") / name).write_text(str(value), encoding="ascii")

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
