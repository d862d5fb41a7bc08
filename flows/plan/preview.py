"""The preview: what a campaign would run, in counts and pictures, and how long it may take."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from vastflow.flows.terminal.display import duration_text
from vastflow.flows.terminal.table import terminal_table
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.results.coverage import Coverage, Loss, design_text, excluded, parts, unrealisable
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.places.ground import MAP_KEY
from vastflow.producers.places.stops import PATH_KEY, PATH_LENGTH_KEY
from vastflow.sim.model.digest import FileContent
from vastflow.sim.reading.script import script_of
from vastflow.sim.world.map_file import load_map

if TYPE_CHECKING:
    from vastflow.oracles.figures.plan_view import PlanView


MEAN_SPEED_MPS: Final = 0.3
"""Along the path, with stops and recoveries: 120 runs of some 6 m in `campaigns/quickstart` are about 40 minutes."""
TIMES_REAL_TIME: Final = 200.0
"""Of one core. `vastflow bench sim` measures it; less than it printed on a shared core of 2026, for runs are judged too."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Simulated time of all runs, and what it takes on so many cores.

    Attributes:
        timeout_s: Simulated time that no run exceeds.
    """

    simulated_s: float
    timeout_s: float
    cores: int

    @property
    def wall_s(self) -> float:
        """Time it may take on this machine."""
        return self.simulated_s / (TIMES_REAL_TIME * self.cores)

    @property
    def how(self) -> str:
        """What was assumed, in one sentence."""
        cores = "1 core" if self.cores == 1 else f"{self.cores} cores"
        return (
            f"each run its path at {MEAN_SPEED_MPS:g} m/s, {self.timeout_s:g} s at most, {cores} of {TIMES_REAL_TIME:g} times "
            "real time each; without Prefect's start, compilation and what the store has"
        )


def estimate_of(configurations: Iterable[Configuration], runs: int, timeout_s: float, cores: int) -> Estimate:
    """The estimate for `runs` of each configuration that is no duplicate."""
    distinct = (configuration for configuration in configurations if configuration.duplicate_of is None)
    simulated_s = runs * sum(min(timeout_s, route_m(each) / MEAN_SPEED_MPS) for each in distinct)
    return Estimate(simulated_s, timeout_s, cores)


def route_m(configuration: Configuration) -> float:
    """Length of a configuration's route: of its path, else straight from stop to stop; infinite where it has no mission."""
    try:
        script = script_of(configuration.scenario)
    except ValueError:
        return math.inf
    if script.start is None or not script.goals:
        return math.inf
    length_m = configuration.provenance.get(PATH_LENGTH_KEY)
    if isinstance(length_m, int | float):
        return script.rounds * length_m
    stops = (script.start, *script.goals)  # of every round
    return sum(math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in itertools.pairwise(stops))


MOST_REASONS = 20
"""Reasons in the terminal; `--json` has more."""


def preview_json(coverage: Coverage, runs: int, estimate: Estimate, pictures: list[str]) -> dict[str, Any]:
    """Counts of the campaign and of each family, the estimate, and the files that were written."""
    families = {
        name: {
            **_counts(part, runs),
            "excluded_by": part["excluded_by"],
            "rejected_by": part["unrealisable_by"],
            "design": part["design"],
        }
        for name, part in coverage["families"].items()
    }
    return {
        **_counts(coverage, runs),
        "families": families,
        "estimate_s": round(estimate.wall_s, 1),
        "pictures": pictures,
    }


def preview_text(
    coverage: Coverage, runs: int, estimate: Estimate, least: int | None = None
) -> Iterator[RenderableType]:
    """The same for people.

    Args:
        least: Runs that each configuration has at least, where `runs` is the most.
    """
    table = terminal_table(("family",), tuple(_counts(coverage, runs)), ("design",))
    for name, part in parts(coverage):
        design = design_text(part["design"]) if "design" in part else ""
        table.add_row(name, *(f"{n:,}" for n in _counts(part, runs).values()), design)
    yield table
    yield from _lost("rejected: can't be built", list(unrealisable(coverage)))
    yield from _lost("excluded by constraints", list(excluded(coverage)))
    yield ""
    if least is not None:
        yield Text(f"runs at most: a configuration has {least} to {runs}, and ends when its class is decided")
    yield Text(
        f"estimate: {'about' if least is None else 'at most about'} {duration_text(estimate.wall_s)} for {duration_text(estimate.simulated_s)} of simulated time "
        f"({estimate.how})"
    )


def plan_view_of(configuration: Configuration) -> "PlanView":
    """What there is to draw of a configuration.

    Raises:
        ValueError: it has no map, or a mission or an obstacle that can't be read.
    """
    from vastflow.oracles.figures.plan_view import PlanView
    from vastflow.oracles.figures.scene import zones_of

    map_file = configuration.scenario.environment.get(MAP_KEY)
    map_path = map_file.path if isinstance(map_file, FileContent) else None
    if map_path is None:
        raise ValueError("it has no map")
    path, length_m = (configuration.provenance.get(key) for key in (PATH_KEY, PATH_LENGTH_KEY))
    title = configuration.name + (f" · path of {length_m:.2f} m" if isinstance(length_m, int | float) else "")
    path_xy_m = np.array(path if isinstance(path, list) else [], dtype=np.float64).reshape(-1, 2)
    scenario = configuration.scenario
    return PlanView(title, load_map(map_path), situation_of(scenario), path_xy_m, zones_of([scenario]))


def _counts(part: Coverage, runs: int) -> Mapping[str, int]:
    return {
        "configurations": part["realised"],
        "rejected": part["unrealisable"],
        "excluded": part["excluded"],
        "duplicates": part["duplicate"],
        "runs": part["realised"] * runs,
    }


def _lost(title: str, rows: list[Loss]) -> Iterator[RenderableType]:
    if not rows:
        return
    yield ""
    yield Text(title, "bold")
    yield lost_table(rows[:MOST_REASONS])
    if rest := rows[MOST_REASONS:]:
        yield Text(f"and {sum(row.times for row in rest):,} more for {len(rest):,} other reasons; see --json", "dim")


def lost_table(rows: list[Loss]) -> Table:
    """A row for each family, producer or constraint, and reason."""
    table = terminal_table()
    table.add_column(justify="right", no_wrap=True)
    for row in rows:
        table.add_row(f"{row.times:,} ×", row.family, row.by, row.reason)
    return table
