"""The log of a run: what its host saw of it. It stands beside the recording, outside every digest."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Use:
    """What the processes of a run use at a moment.

    Attributes:
        t_s: Host time since the first sample.
        cpu_s: Processor time of all processes seen so far, ended ones as they were seen last.
        rss_bytes: Resident memory of those that live; pages they share count for each.
        processes: How many live.
    """

    t_s: float
    cpu_s: float
    rss_bytes: int
    processes: int


@dataclass(frozen=True, slots=True)
class LogText:
    """What one command printed.

    Attributes:
        label: What the scenario calls it, or `pre_command`, `post_command`; may be empty.
        cut: Whether there was more.
    """

    label: str
    command: tuple[str, ...]
    text: str = field(repr=False)
    cut: bool


@dataclass(frozen=True, slots=True)
class RunLog:
    """What is known of a run beside what happened in it.

    Attributes:
        started_s: When it began, in seconds since 1970 (UTC).
        wall_s, cpu_s: What it took of this process, or of the run's own processes where it had some.
        max_rss_bytes: Most memory that this process, or the run's own, had in use.
        lines: What the scenario logged, each with its simulated time.
        texts: What each program printed.
        resources: Of the run's processes, once a second of host time; a run without any has none.
        notes: What could not be kept of its outputs, and how `post_command` ended.
    """

    started_s: float
    wall_s: float
    cpu_s: float
    max_rss_bytes: int
    lines: tuple[str, ...] = ()
    texts: tuple[LogText, ...] = ()
    resources: tuple[Use, ...] = ()
    notes: tuple[str, ...] = field(default=())


def run_log_row(log: RunLog) -> dict[str, Any]:
    """`log` as plain JSON values."""
    return asdict(log)


def run_log_of(row: Mapping[str, Any]) -> RunLog:
    """The log that `run_log_row` wrote.

    Raises:
        KeyError, TypeError: the row is none.
    """
    texts = tuple(LogText(**{**text, "command": tuple(text["command"])}) for text in row["texts"])
    resources = tuple(Use(**use) for use in row["resources"])
    numbers = (row["started_s"], row["wall_s"], row["cpu_s"], row["max_rss_bytes"])
    return RunLog(*numbers, tuple(row["lines"]), texts, resources, tuple(row["notes"]))
