"""The summary: a campaign's counts, as `--json` prints them, and where its directory is."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vastflow.oracles.statistics.intervals import Counts

if TYPE_CHECKING:
    import pandas as pd

    from vastflow.oracles.figures.style import Plot
    from vastflow.tasks.engine.engine import RunFault


@dataclass(frozen=True, slots=True)
class Work:
    """The work of one call, without the results found in the store.

    Attributes:
        executed, reused: Runs that were simulated, and those whose recordings were in the store.
        simulated_s: Simulated time of the executed runs, so that `simulated_s / cpu_s` is a speed.
        cpu_s: CPU time of all processes of the call, Prefect's embedded server and workers included, and of units on a cluster's workers.
    """

    executed: int
    reused: int
    simulated_s: float
    cpu_s: float
    wall_s: float


@dataclass(frozen=True, slots=True)
class Summary:
    """A campaign in numbers.

    Attributes:
        configurations: Distinct configurations; duplicates are counted apart.
        rejected: Instances that could not be built.
        duplicates: Configurations with the content of an earlier one, run once in its stead.
        runs: Runs asked for: executed, reused, or broken by a fault.
        executed, reused, simulated_s, cpu_s, wall_s: See `Work`.
        passed, failed, not_judged: Runs. A run passes when every oracle passes and fails when one fails.
        results: The campaign directory.
        oracles: Name of an oracle to its judgments; the mission's own outcome is `success`.
        excluded: Instances that constraints exclude.
        excluded_by: Family to how many instances each constraint excludes.
        stood_still: Failed runs whose robot was sent and never moved.
        sampled_from: Number of distinct configurations that the sample is drawn from; None without a sample.
        headline: See `vastflow.oracles.evidence.headline.Headline.as_json`; empty without a report.
    """

    configurations: int
    rejected: int
    duplicates: int
    runs: int
    executed: int
    reused: int
    passed: int
    failed: int
    not_judged: int
    simulated_s: float
    cpu_s: float
    wall_s: float
    results: str
    oracles: Mapping[str, Counts]
    excluded: int = 0
    excluded_by: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    sampled_from: int | None = None
    stood_still: int = 0
    headline: Mapping[str, object] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """Plain values, seconds rounded to milliseconds."""
        seconds = {name: round(getattr(self, name), 3) for name in ("simulated_s", "cpu_s", "wall_s")}
        return {**asdict(self), **seconds}

    def json_text(self) -> str:
        """One line of JSON."""
        return json.dumps(self.as_json(), ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class Results:
    """A campaign directory that has been written.

    Attributes:
        faults: Faults of the campaign; without any, every run was judged as far as the oracles could.
        notes: Notes on the campaign's files for the user, line by line as `terminal_lines` gives them; `metadata.json`
            has all.
    """

    directory: Path
    summary: Summary
    faults: "tuple[RunFault, ...]"
    notes: tuple[str, ...]

    def frame(self) -> "pd.DataFrame":
        """One row for each run, see `vastflow.oracles.evidence.wide.wide_table`."""
        from vastflow.oracles.evidence.wide import wide_table
        from vastflow.oracles.results.tables import read_tables

        return wide_table(read_tables(self.directory))

    def plot(self) -> "Plot":
        """Draw the rates of families and oracles with their intervals, as in the report."""
        from vastflow.oracles.evidence.evidence import evidence_of
        from vastflow.oracles.figures.charts import rate_panels, rates_figure
        from vastflow.oracles.figures.style import Plot
        from vastflow.oracles.results.tables import read_tables

        return Plot(rates_figure(rate_panels(evidence_of(read_tables(self.directory)))))

    def _repr_html_(self) -> str | None:
        """The headline for a notebook; None without the directory, so that the notebook shows `repr`."""
        from vastflow.oracles.page.headline import headline_html

        try:
            return headline_html(self.directory)
        except (OSError, ValueError):
            return None


def summary_of(counts: Mapping[str, Any], directory: Path) -> Summary:
    """Return the summary of a campaign directory with these `counts` in its `metadata.json`."""
    oracles = {name: Counts(**each) for name, each in counts["oracles"].items()}
    return Summary(**{**counts, "oracles": oracles, "results": str(directory)})
