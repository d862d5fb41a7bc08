"""The page that puts results beside the paper's: figures from campaign directories, words from a template.

    python docs/studies/paper_page.py RESULTS...

runs this file, as `python docs/studies/paper_page.py RESULTS...` does.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import paper_published as published
import typer
from jinja2 import Environment, StrictUndefined
from paper_results import PaperResults, WeightedRate, paper_results, weighted_counts, weighted_rate

from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import BAD_INPUT, Interruptible
from vastflow.oracles.results.unusable import reading
from vastflow.oracles.statistics.classes import TotalFailures, total_failures
from vastflow.oracles.statistics.intervals import Counts, Interval
from vastflow.sim.loop.standstill import CAUSES, STANDSTILL_M
from vastflow.sim.model.faults import UserError

CORES: Final = 2
"""For which the time of the whole campaigns is said."""
_TEMPLATE: Final = Path(__file__).with_name("paper_page.md.j2")


def main(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULTS...", help="Campaign directories of campaigns in campaigns/paper.")
    ],
    delays: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", exists=True, dir_okay=False, help="What docs/studies/spawn_delays.py --json wrote."
        ),
    ] = None,
) -> None:
    """Print a page that puts results beside the paper's.

    Markdown on standard output; the same results give the same text.
    """
    with Interruptible("interrupted"):
        try:
            late = json.loads(delays.read_text(encoding="utf-8")) if delays else None
            print(paper_page([_read(directory) for directory in results], late), end="")
        except UserError as error:
            print(error, file=sys.stderr)
            raise typer.Exit(BAD_INPUT) from None


def _read(directory: Path) -> PaperResults:
    check_directory(directory)
    with reading(directory):
        return paper_results(directory)


def paper_page(results: Sequence[PaperResults], delays: Mapping[str, Any] | None = None) -> str:
    """The page of one or several campaigns, in their order; the same results give the same text.

    Args:
        delays: Content of the file that `spawn_delays.py --json` writes.
    """
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters.update(percent=percent, rate=rate_text, span=span, number=number, speed=speed)
    return environment.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(
        results=results,
        delays=delays,
        published=published,
        cores=CORES,
        distinct=[weighted_rate(each.counts, {}, blocks=each.blocks) for each in results],
        weighted=[weighted_rate(each.counts, each.weights, blocks=each.blocks) for each in results],
        total=[_total(each.counts) for each in results],
        weighted_total=[_total(weighted_counts(each.counts, each.weights)) for each in results],
        runs_of_all=[each.requested.distinct * published.RUNS for each in results],
        hours_of_all=[hours(each) for each in results],
        together=_together(results),
        standstill_m=STANDSTILL_M,
        causes=CAUSES,
        executed=sum(each.executed for each in results),
        cpu_s=sum(each.cpu_s for each in results),
        least_runs=min((each.runs for each in results), default=0),
        sampled=any(each.sampled_from is not None for each in results),
        of_kind={each.kind: each for each in results},
    )


def hours(results: PaperResults) -> float:
    """Simulated hours of the whole campaign, each distinct configuration as often as in the paper."""
    return results.requested.distinct * published.RUNS * results.ways[0].simulated_s / 3600


def _together(results: Sequence[PaperResults]) -> tuple[float, float] | None:
    """Return CPU hours of all whole campaigns, by simulation speed and by calls; None for fewer than two."""
    least = most = 0.0
    for each in results:
        if each.alone is None or each.call is None:
            return None
        least += hours(each) / each.alone
        most += hours(each) / each.call
    return (least, most) if len(results) > 1 else None


def _total(counts: Mapping[str, Counts]) -> TotalFailures:
    return total_failures([each.passed for each in counts.values()], [each.judged for each in counts.values()])


def percent(share: float | None) -> str:
    """`61.2 %`; a dash where there is none."""
    return "–" if share is None else f"{100 * share:.1f} %"


def span(interval: Interval | None) -> str:
    """`[48.1, 85.5]`, in percent and rounded outwards, as the report has it; a dash where there is none."""
    if interval is None:
        return "–"
    low, high = interval.thousandths
    return f"[{low / 10:.1f}, {high / 10:.1f}]"


def rate_text(counts: Counts | WeightedRate) -> str:
    """A rate with its interval."""
    return "–" if counts.rate is None else f"{percent(counts.rate)} {span(counts.interval)}"


def speed(times: float | None) -> str:
    """`140`; a dash where it was not measured."""
    return "–" if times is None else f"{times:,.0f}"


def number(value: float, digits: int = 0) -> str:
    """`1,816`, `17.1`."""
    return f"{value:,.{digits}f}"


if __name__ == "__main__":
    typer.run(main)
