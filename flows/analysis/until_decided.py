"""`compared_until_decided`: two campaigns, run round by round until their comparison is decided."""

from collections.abc import Callable
from contextvars import Context, copy_context
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Literal, TypeAlias

from vastflow.flows.analysis.comparison import Compared, compared
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.summary import Results
from vastflow.oracles.results.tables import Tables, read_tables
from vastflow.sim.model.faults import UserError

Run: TypeAlias = Callable[[RunRequest], Results]
"""Runs a campaign, such as `vastflow.flows.api.run_campaign`."""
Shown: TypeAlias = Literal["nothing changed", "lost the margin", "worse", "better", "loss ruled out"]
_WORDS: Final = {
    "nothing changed": "nothing changed",
    "lost the margin": "B is worse by more than {margin:g} points",
    "worse": "B is worse",
    "better": "B is better",
    "loss ruled out": "a loss of {margin:g} points or more is ruled out",
}


@dataclass(frozen=True)
class Side:
    """A campaign to compare.

    Attributes:
        context: Context of its runs, which holds the code that the user permits.
    """

    request: RunRequest
    context: Context = field(default_factory=copy_context, repr=False)

    def rounds(self) -> int:
        """Return the runs asked for of each configuration, or the file's; at most, where they end by a rule.

        Raises:
            FileError: faults of the file.
            UserError: it is a search.
        """
        asked = self.request
        map_dir = None if asked.map_dir is None else Path(asked.map_dir)
        campaign, _ = self.context.run(read_campaign, Path(asked.campaign), map_dir, strict=asked.strict)
        if campaign.search is not None:
            raise UserError(
                f"{asked.campaign}: expected a campaign that lists its configurations, got a search, whose results choose them"
            )
        return campaign.runs_asked(asked.runs, asked.sample)

    def tables(self, run: Run, runs: int, results: str) -> Tables:
        """Run so many runs of each configuration into a folder or address, and read them."""
        request = self.request.model_copy(update={"runs": runs, "results": results})
        return read_tables(self.context.run(run, request).directory)


@dataclass(frozen=True, slots=True)
class Decision:
    """The end of a comparison's rounds.

    Attributes:
        shown: All that is shown, the strongest first; empty if undecided.
        rounds, most: Rounds that were run, and those of the whole plan.
        runs, planned: Runs of both campaigns, and those of the whole plan.
    """

    shown: tuple[Shown, ...]
    rounds: int
    most: int
    runs: int
    planned: int
    margin: float

    @property
    def text(self) -> str:
        """The decision in a sentence, and what it took."""
        rounds = f"after {self.rounds} of {self.most} rounds"
        if not self.shown:
            ended = f"undecided {rounds}"
        else:
            ended = f"decided {rounds}: {_WORDS[self.shown[0]].format(margin=100 * self.margin)}"
        return f"{ended}; {self.runs:,} runs of A and B, {self.planned:,} in all rounds"


def compared_until_decided(
    before: Side,
    after: Side,
    run: Run,
    *,
    oracle: str | None = None,
    margin: float = 0.02,
    notify: Callable[[str], object] = lambda text: None,
) -> tuple[Compared, Decision]:
    """Run two campaigns until it is decided whether the second loses, and compare them.

    Round r adds run r of every configuration. The rounds end once a loss of `margin` or more is ruled out, a loss is shown, or nothing can
    change. All of it is read from one interval that holds at every look, so at most 5 % of comparisons end with a false decision. With a margin
    of 0, the rounds end once the second is shown to be better or worse. The directories of the last round stay, in the requests' results.

    Args:
        notify: Is told of each round.

    Raises:
        FileError: faults of a file.
        UserError: a search.
        UnusableDirectory: an unknown oracle, or no pair of runs that was judged both times.
    """
    most = min(before.rounds(), after.rounds())
    for rounds in range(1, most + 1):
        with TemporaryDirectory(prefix="vastflow-") as folder:
            found = _compared((before, after), run, rounds, (f"{folder}/A", f"{folder}/B"), oracle, margin)
        low, high = (100 * end for end in found.whole.interval)
        notify(
            f"round {rounds} of {most}: B {100 * found.whole.difference:+.1f} points, 95 % {low:+.1f} to {high:+.1f}"
        )
        if shown := _shown(found):
            break
    results = before.request.results, after.request.results
    found = _compared((before, after), run, rounds, results, oracle, margin)
    each = sum(len(tables.configurations.distinct) for tables in (found.before, found.after))
    return found, Decision(shown, rounds, most, each * rounds, each * most, margin)


def _compared(
    sides: tuple[Side, Side], run: Run, runs: int, results: tuple[str, str], oracle: str | None, margin: float
) -> Compared:
    then, now = (side.tables(run, runs, place) for side, place in zip(sides, results, strict=True))
    return compared(then, now, oracle, margin, until_decided=True)


def _shown(found: Compared) -> tuple[Shown, ...]:
    (low, high), margin = found.whole.interval, found.gate.margin
    claims: dict[Shown, bool] = {
        "nothing changed": found.gate.status == "nothing changed",
        "lost the margin": high < -margin,
        "worse": high < 0.0,
        "better": low > 0.0,
        "loss ruled out": low > -margin,
    }
    return tuple(claim for claim, holds in claims.items() if holds)
