"""The log of a run on its host, beside the recording and outside every digest."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Use:
    """Resource usage of a run's processes at a moment.

    Attributes:
        t_s: Host time since the first sample.
        cpu_s: CPU time of all processes seen so far.
        rss_bytes: Resident memory of live processes; shared pages count for each.
        processes: Number of live processes.
    """

    t_s: float
    cpu_s: float
    rss_bytes: int
    processes: int


@dataclass(frozen=True, slots=True)
class LogText:
    """Output of one command.

    Attributes:
        label: Name in the scenario, or `pre_command`, `post_command`; may be empty.
        cut: True if there was more.
    """

    label: str
    command: tuple[str, ...]
    text: str = field(repr=False)
    cut: bool


@dataclass(frozen=True, slots=True)
class RunLog:
    """Log of a run.

    Attributes:
        started_s: Start in seconds since 1970 (UTC).
        wall_s, cpu_s: Time of this process, or of the run's own processes if it had any.
        max_rss_bytes: Peak memory of the same.
        lines: Log of the scenario, each line with its simulated time.
        texts: Output of each program.
        resources: Samples of the run's processes, once a second of host time.
        notes: Outputs that were left out, and how `post_command` ended.
    """

    started_s: float
    wall_s: float
    cpu_s: float
    max_rss_bytes: int
    lines: tuple[str, ...] = ()
    texts: tuple[LogText, ...] = ()
    resources: tuple[Use, ...] = ()
    notes: tuple[str, ...] = ()


def run_log_row(log: RunLog) -> dict[str, Any]:
    """Return `log` as plain JSON values."""
    return asdict(log)


def run_log_of(row: Mapping[str, Any]) -> RunLog:
    """Read a log that `run_log_row` wrote; raises `KeyError` or `TypeError` for other rows."""
    texts = tuple(LogText(**{**text, "command": tuple(text["command"])}) for text in row["texts"])
    resources = tuple(Use(**use) for use in row["resources"])
    numbers = (row["started_s"], row["wall_s"], row["cpu_s"], row["max_rss_bytes"])
    return RunLog(*numbers, tuple(row["lines"]), texts, resources, tuple(row["notes"]))
