"""Points: which process of a campaign is killed when, and what that came to."""

import json
import random
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Literal, TypeAlias

from killed_life import CONFIGURATIONS, ENDS_S

Setting: TypeAlias = Literal["embedded", "local", "server", "cluster"]
"""Prefect's API as the campaign starts it; that, and `--cluster local:N`; a configured server; that, and a Dask cluster whose workers execute
the runs."""

VICTIMS: dict[Setting, tuple[str, ...]] = {
    "embedded": ("flow", "worker", "server"),
    "local": ("flow", "worker", "scheduler"),
    "server": ("flow", "server"),
    "cluster": (
        *("flow", "server", "nanny", "worker", "node", "scheduler"),
        *("paused flow", "paused worker", "paused scheduler"),
    ),
}
"""The flow's process; a process of its pool; Prefect's server. Of a Dask cluster: the process that watches over a worker, the
worker itself, both at once, as when a machine is gone (`node`), and the scheduler. One that is paused goes on after `PAUSE_S`."""

PAUSED = "paused "
PAUSE_S = 8.0
"""Duration of a pause (SIGSTOP), in which Dask loses no worker."""

OF_A_CREW = ("nanny", "worker", "node", "scheduler")
IN_FLIGHT = ("node",)
"""They are killed while they execute a block of runs."""

STARTING, REPORTING = 0.2, 0.8
"""Shares of the points that are before execution, and that are not after it."""
REPORT = CONFIGURATIONS + 1
REPORTING_S = 0.5
"""So long the campaign directory is written."""
BLOCK_S = 0.6
"""So long a block of runs is executed."""
BACK_S = (0.0, 5.0, ENDS_S)
"""A configured API that was killed comes back after so long, by the number of the point; the last is never."""

Times: TypeAlias = Mapping[Setting, Mapping[str, tuple[float, float]]]
"""When each victim is there before anything is executed, first and last (s)."""


@dataclass
class Point:
    """Outcome of one kill.

    Attributes:
        number: Among those of the same victim.
        at_s: Not before this time after the start.
        blocks: Nor before so many blocks are executed; `REPORT`: before the campaign directory is begun.
        aimed_s: And so long after that.
        cut: Runs whose block a process began and never ended: they were in flight when it died. By scenario digest and run index.
        load: Load of the machine in the minute before the kill.
        back_s: Time (s) that a configured API was away; -1 for until the campaign had ended.
    """

    setting: Setting
    victim: str
    number: int
    at_s: float
    blocks: int = 0
    aimed_s: float = 0.0
    phase: str = ""
    load: float = 0.0
    exit_code: int | None = None
    back_s: float = 0.0
    after_s: float = 0.0
    how: str = ""
    resumed: int = 0
    cut: set[tuple[str, int]] = field(default_factory=set)
    executed_twice: int = 0
    violations: list[str] = field(default_factory=list)

    @property
    def is_pause(self) -> bool:
        return self.victim.startswith(PAUSED)

    @property
    def process_kind(self) -> str:
        """Kind of the process that is killed or paused."""
        return self.victim.removeprefix(PAUSED)

    @property
    def kind(self) -> str:
        return f"{self.setting}/{self.victim}"

    def earlier(self) -> None:
        """Move the kill to an earlier time, since the campaign had ended."""
        self.at_s, self.blocks, self.aimed_s = 0.5 * self.at_s, self.blocks // 2, 0.3 * self.aimed_s


def kinds_of(settings: Sequence[Setting], victims: Sequence[str]) -> list[tuple[Setting, str]]:
    """Setting and victim of all points; none of `victims` means all."""
    return [(s, victim) for s in settings for victim in VICTIMS[s] if not victims or victim in victims]


def points(seed: int, total: int, kinds: Sequence[tuple[Setting, str]], there: Times) -> Iterator[Point]:
    """So many points in all, as many of each kind as of another or one fewer, kind by kind.

    Those of a kind are spread over what a campaign does, one in each of as many equal parts, in random order: a fifth while it
    starts, by the clock; three fifths while it executes, by how much is executed; and a fifth after that.
    """
    for place, (setting, victim) in enumerate(kinds):
        number = total // len(kinds) + (place < total % len(kinds))
        rng = random.Random(f"{seed} {setting} {victim}")
        parts = rng.sample(range(number), number)
        for k in range(number):
            yield _point(setting, victim, k, (parts[k] + rng.random()) / number, rng, there)


def _point(setting: Setting, victim: str, number: int, share: float, rng: random.Random, there: Times) -> Point:
    if victim in IN_FLIGHT or victim.startswith(PAUSED):  # they are there while they execute, and no longer
        return Point(setting, victim, number, 0.0, int(share * (CONFIGURATIONS - 2)), rng.uniform(0.0, BLOCK_S))
    if share < STARTING:
        first_s, last_s = there[setting][victim]
        return Point(setting, victim, number, first_s + share / STARTING * (last_s - first_s))
    if share < REPORTING:
        blocks = int((share - STARTING) / (REPORTING - STARTING) * CONFIGURATIONS)
        return Point(setting, victim, number, 0.0, blocks, rng.uniform(0.0, BLOCK_S))
    if victim == "flow":
        return Point(setting, victim, number, 0.0, REPORT, rng.uniform(0.0, REPORTING_S))
    return Point(setting, victim, number, 0.0, CONFIGURATIONS, rng.uniform(0.0, 1.0))


HEADER = (
    f"{'setting':8} {'victim':16} {'no':>2} {'at (s)':>6} {'blocks':>6} {'phase':9} {'then':9} {'for (s)':>7} {'':6} "
    f"{'in flight':>9} {'twice':>5}"
)


def line(point: Point) -> str:
    """A point in a line of the table."""
    judged = "; ".join(point.violations) or "ok"
    return (
        f"{point.setting:8} {point.victim:16} {point.number:2} {point.at_s:6.1f} {point.blocks:6} {point.phase:9} "
        f"{point.how:9} {point.after_s:7.1f} {'resume' if point.resumed else '':6} {len(point.cut):9} "
        f"{point.executed_twice:5}  {judged}"
    )


def totals(done: Sequence[Point]) -> list[str]:
    """A line for each kind of points, and one for all."""
    lines = []
    for kind, number in Counter(point.kind for point in done).items():
        of_kind = [point for point in done if point.kind == kind]
        twice = sum(point.executed_twice for point in of_kind)
        hit = sum(bool(point.cut) for point in of_kind)
        bad = sum(bool(point.violations) for point in of_kind)
        lines.append(
            f"{kind}: {number} points, {hit} with runs in flight, {twice} runs executed twice, {bad} with a violation"
        )
    bad, twice = sum(bool(point.violations) for point in done), sum(point.executed_twice for point in done)
    return [*lines, f"{len(done)} points, {bad} with a violation; {twice} runs executed twice"]


def as_json(seed: int, done: Sequence[Point]) -> str:
    """Return the points as JSON."""
    told = [{**asdict(point), "cut": len(point.cut)} for point in done]
    return json.dumps({"seed": seed, "violated": sum(bool(point.violations) for point in done), "points": told})
