"""Answers on campaign directories: methods that are tools, with the numbers of the report and the explorer."""

import threading
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, TypeVar

from pydantic import Field

from vastflow.deployments.assistant.sql import TABLES, answer_sql
from vastflow.deployments.explorer.directories import CampaignDirectory, Directories, headline_of
from vastflow.deployments.explorer.opened import OpenedCampaigns
from vastflow.oracles.evidence.headline import robot_text
from vastflow.oracles.judgment.cause import CAUSES
from vastflow.oracles.query import facets
from vastflow.oracles.query.selection import Column, ValuesOf, mask_of
from vastflow.oracles.results.tables import FAIL, Tables, read_tables
from vastflow.oracles.results.unusable import DAMAGE, UnusableDirectory, reading
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.names import did_you_mean

if TYPE_CHECKING:
    from vastflow.oracles.evidence.evidence import Group

MOST: Final = 200
"""Rows of an answer."""
MOST_LEVELS: Final = 12
MOST_PATHS: Final = 100
"""Runs in a picture."""
_KEPT: Final = 2
_COUNTS: Final = ("configurations", "rejected", "passed", "failed", "not_judged", "runs_done", "runs_total")
_CAMPAIGN: Final = "Id from `campaigns`; empty if one campaign is served."
_HOW: Final = (
    "A rate is the mean of the rates of configurations, without runs that were not judged; of runs that a rule ended, each has its `weight`. "
    "At 95 %, `interval` is for these configurations "
    "if they were run again, `others` for others of their kind; null where nothing follows."
)
_MEANINGS: Final[Mapping[str, str]] = {
    "passed": "joint verdict of all oracles; NULL is not judged, neither passed nor failed",
    "cause": "cause of a failed run, see `failures`",
    "stood_still": "why the robot never moved; NULL if it moved",
    "missed_goals": "goals that were given up",
    "purpose": "search, or confirmation of the best point by fresh runs",
    "metric": "metric of the oracle before the dot",
    "path": "property of the drawn path",
    "verdict": "verdict of this oracle; NULL is not judged",
}
"""Meanings of columns whose names don't tell them, by name or group."""

Campaign: TypeAlias = Annotated[str, Field(description=_CAMPAIGN)]
Configuration: TypeAlias = Annotated[str, Field(description="Name of a configuration; empty: all.")]
Oracle: TypeAlias = Annotated[str, Field(description="Name of an oracle; empty: all together.")]
Limit: TypeAlias = Annotated[int, Field(ge=1, le=MOST, description="Most rows.")]
Offset: TypeAlias = Annotated[int, Field(ge=0, lt=1 << 31, description="First row.")]


Name = TypeVar("Name", str, int)


class Answers:
    """Answers on the campaign directories that are looked up anew for each question; methods raise `UserError`."""

    def __init__(self, directories: Directories) -> None:
        self._directories = directories
        self._opened = OpenedCampaigns(directories)
        self._read = lru_cache(_KEPT)(_tables)
        self._drawing = threading.Lock()

    def directory(self, campaign: str) -> CampaignDirectory:
        """Return a campaign by its id; empty is the only one."""
        known = {each.id: each for each in self._directories.all()}
        return known[_known("campaign", campaign or (next(iter(known)) if len(known) == 1 else ""), known)]

    def _tables(self, campaign: str) -> Tables:
        directory = self.directory(campaign)
        if directory.state == "running":
            raise UnusableDirectory(f"{directory.id}: It is still running. `campaigns` shows its progress.")
        return self._read(directory, directory.path.stat().st_mtime_ns)

    def campaigns(self, limit: Limit = 20, offset: Offset = 0) -> dict[str, Any]:
        """List campaigns, newest first: id, state, headline rate with intervals, counts of runs."""
        every = self._directories.all()
        rows = []
        for each in every[offset : offset + limit]:
            counts = each.metadata.get("counts") or each.progress
            told = {name: getattr(each, name) for name in ("name", "created", "state", "problem")}
            told |= {"headline": headline_of(each).get("text", ""), "robot": robot_text(each.metadata)}
            told |= {"faults": len(each.faults), **{name: counts[name] for name in _COUNTS if name in counts}}
            rows.append({"campaign": each.id, **told})
        step = f"failures(campaign={rows[0]['campaign']!r})" if rows else "vastflow run FILE"
        return _page("campaigns", rows, len(every), offset, step)

    def tables(self, campaign: Campaign = "") -> dict[str, Any]:
        """Describe the tables and columns that `sql` may name: units, meanings, levels, ranges."""
        id = self.directory(campaign).id
        table = self._opened.of(id).table
        return {
            "campaign": id,
            "runs": len(table),
            "tables": {name: f"{meaning}; with a column campaign" for name, (_, _, meaning) in TABLES.items()},
            "columns_of_runs": [*map(_column, table.columns.values())],
            "next_step": 'sql(query="SELECT configuration, count(*) FROM runs GROUP BY ALL"), names with other characters in double '
            "quotes; rates with intervals are in `rates`",
        }

    def sql(
        self,
        query: Annotated[str, Field(description="One SELECT in DuckDB's dialect over the tables of `tables`.")],
        campaign: Annotated[str, Field(description="Id from `campaigns`; empty: all finished ones.")] = "",
        limit: Limit = 100,
        offset: Offset = 0,
    ) -> dict[str, Any]:
        """Answer one read-only SELECT. Rates with intervals are in `rates`."""
        chosen = self._finished(campaign)
        found = answer_sql({each.id: each.path for each in chosen}, query, limit, offset)
        return {"campaigns": len(chosen), **found, "next_step": "rates(…), as avg(passed) has no interval"}

    def _finished(self, campaign: str) -> list[CampaignDirectory]:
        every = [self.directory(campaign)] if campaign else self._directories.all()
        return [each for each in every if campaign or each.state == "finished"]

    def rates(
        self,
        campaign: Campaign = "",
        by: Annotated[
            str, Field(description="family, configuration, oracle, or a factor, over all families; empty: no groups.")
        ] = "",
        oracle: Oracle = "",
        limit: Limit = 50,
        offset: Offset = 0,
    ) -> dict[str, Any]:
        """Return a campaign's pass rates with sample sizes and 95 % intervals."""
        from vastflow.oracles.evidence.evidence import evidence_of

        found = self._tables(campaign)
        evidence = evidence_of(found)
        judged = evidence[_known("oracle", oracle, evidence) if oracle else None]
        whole = judged.campaign
        groups: Mapping[Any, Group]
        if not by:
            groups = {}
        elif by == "family":
            groups = judged.families
        elif by == "oracle":
            groups = {name: evidence[name].campaign for name in found.oracles}
        elif by == "configuration":
            groups = {name: whole.of([name]) for name in whole.by_name}
        else:
            groups = {value: whole.of(names) for value, names in self._levels(campaign, by, whole).items()}
        rows = [{by: name, **_rate(each)} for name, each in [*groups.items()][offset : offset + limit]]
        for row in rows if by == "configuration" else ():  # of one, the report has the share of its runs
            mean = whole.means[row[by]]
            row |= {"rate": mean and mean[0], "interval": mean and [mean[1].low, mean[1].high]}
        page = _page("rates", rows, len(groups), offset, f"failures(campaign={self.directory(campaign).id!r})")
        return {"headline": whole.headline.text, "whole": _rate(whole), **page, "how": _HOW}

    def _levels(self, campaign: str, factor: str, whole: "Group") -> dict[float | str | None, list[str]]:
        """Return the configurations of each value of a factor, or of a path's property."""
        table = self._opened.of(self.directory(campaign).id).table
        factors = [name for name, each in table.columns.items() if each.group in ("factor", "path")]
        _known("by", factor, ["family", "configuration", "oracle", *factors])
        levels: dict[float | str | None, list[str]] = {}
        for k, name in enumerate(table.configurations):
            if name in whole.by_name and (rows := table.rows_of(k)):
                levels.setdefault(table.value(factor, rows[0]), []).append(name)
        return levels

    def failures(
        self, campaign: Campaign = "", configuration: Configuration = "", limit: Limit = 20, offset: Offset = 0
    ) -> dict[str, Any]:
        """Tell why runs failed: causes, reasons by oracle, findings, and failing configurations with rates."""
        from vastflow.oracles.page.failures import failure_kinds

        id = self.directory(campaign).id
        opened = self._opened.of(id)
        with reading(id):
            table = opened.table
            names = (_known("configuration", configuration, table.configurations),) if configuration else ()
            mask = mask_of(table, {"": ValuesOf("configuration", names)} if names else {})
            told, kinds = facets.reasons_json(table, mask), failure_kinds(opened.failures[mask[opened.failures.row]])
            failing = int((facets.Chosen(table, mask).counts[:, FAIL] > 0).sum())
            shown = opened.facets.varying("factor")[:MOST_LEVELS]
            page = facets.rows_json(table, mask, shown, "failed", descending=True, start=offset, count=limit)
        findings, classes = opened.evidence
        rows = page["rows"][: max(failing - offset, 0)]
        rows = [{**each, "class": classes.get(each["configuration"], "")} for each in rows]
        causes = [{**each, "means": CAUSES.get(each["value"], "")} for each in told["cause"]["rows"]]
        reasons = [{**each, "reason": each["reason"][:300]} for each in kinds[: facets.MOST_REASONS]]
        found = _page("configurations", rows, failing, offset, f"describe_run(campaign={id!r}, …) of an example")
        found["cut"] += [f"{len(kinds) - len(reasons):,} more reasons"] * (len(kinds) > len(reasons))
        told = {"campaign": id, "runs": int(mask.sum()), "failed": told["failed"], "causes": causes, "reasons": reasons}
        return {
            **told,
            "findings": findings * (not names),
            "columns_of_values": page["columns"],
            **found,
            "how": f"{_HOW} A failed run has at most one cause.",
        }

    def describe_run(
        self,
        configuration: Annotated[str, Field(description="Name of a configuration.")],
        run_index: Annotated[int, Field(ge=0, lt=1 << 31, description="Number of the run.")],
        campaign: Campaign = "",
        limit: Limit = 60,
        offset: Offset = 0,
    ) -> dict[str, Any]:
        """Describe one recorded run in words: verdicts with metrics, end, and events with times. Nothing is executed."""
        from vastflow.oracles.query.frames import facts_of, stored_run

        directory = self.directory(campaign)
        facts = facts_of(stored_run(directory.path, configuration, run_index), configuration)
        events, reason, sentence = facts["events"], facts.get("reason", ""), facts["sentence"]
        ended = f"Its mission {facts['outcome'].replace('_', ' ')} after {facts['simulated_s']:.2f} s"
        ended += f": {reason}" * bool(reason)
        failed = [f"{each['oracle']}: {each['reason']}." for each in facts["verdicts"] if each["reason"]]
        end = f"{ended}." if facts["outcome"] else sentence
        words = " ".join([f"{configuration}, run {run_index}: {facts['judgment']}.", end, *failed])
        shown = ("judgment", "sentence", "verdicts", *(() if sentence else ("distance_m", "recoveries")))
        told: dict[str, Any] = {key: facts[key] for key in shown}
        step = f"draw_map(configuration={configuration!r}, run_index=[{run_index}], campaign={directory.id!r})"
        page = _page("events", events[offset : offset + limit], len(events), offset, step)
        return {"campaign": directory.id, "words": words, **told, **page}

    def draw_map(
        self,
        configuration: Annotated[str, Field(description="Name of a configuration.")],
        run_index: Annotated[tuple[int, ...], Field(max_length=MOST, description="Runs to draw; empty: all.")] = (),
        campaign: Campaign = "",
    ) -> tuple[bytes, str]:
        """Draw runs of a configuration on its map, as PNG."""
        from vastflow.flows.analysis.comparison_pictures import driven_case
        from vastflow.oracles.figures.case_figure import case_figure
        from vastflow.oracles.figures.style import png

        found = self._tables(campaign)
        table, verdicts = found.configurations, found.verdicts
        name = table.duplicates.get(_known("configuration", configuration, table.names), configuration)
        own = verdicts.rows_of(table.names.index(name))
        said = dict(zip(verdicts.run_index[own].tolist(), verdicts.together[own].tolist(), strict=True))
        wanted = [_known("run_index", each, said) for each in run_index] or [*said]
        shown = {each: said[each] for each in wanted[:MOST_PATHS]}
        try:
            with self._drawing:  # matplotlib is not made for threads
                picture = png(case_figure(driven_case(found, name, "", shown)))
        except DAMAGE as error:
            raise UserError(f"{configuration} can't be drawn: {error}") from None
        words = f"{configuration}: {len(shown)} of {len(said)} runs, {[*shown.values()].count(FAIL)} failed, which end in a cross"
        left = f"; {len(wanted) - len(shown):,} more are left out" * (len(wanted) > len(shown))
        return picture, f"{words}{left}. The bar is 1 m, circles are starts, diamonds goals, lines true paths."

    def compare(
        self,
        before: Annotated[str, Field(description="Id of the baseline.")],
        after: Annotated[str, Field(description="Id of the candidate.")],
        oracle: Oracle = "",
        margin: Annotated[float, Field(ge=0, le=1, description="Accepted loss, as a share of the runs.")] = 0.02,
        limit: Limit = 20,
    ) -> dict[str, Any]:
        """Compare two campaigns pair by pair of runs: difference with interval, what newly fails, gate."""
        from vastflow.flows.analysis.comparison import compared
        from vastflow.flows.analysis.comparison_text import compared_json

        sides = [self._tables(each) for each in (before, after)]
        with reading(after):
            found = compared(sides[0], sides[1], oracle or None, margin)
        told, cut = compared_json(found, {}) | {"before": before, "after": after}, []
        for part in (told, told["unpaired"]):
            for name, rows in part.items():
                if isinstance(rows, list) and rows[limit:]:
                    cut.append(f"{len(rows) - limit:,} more of {name}")
                    part[name] = rows[:limit]
        words = f"{found.gate.text}. Pairs are runs of one scenario and seed; intervals are at 95 %."
        return {"words": words, **told, "cut": cut, "next_step": f"failures(campaign={after!r})"}


def _tables(directory: CampaignDirectory, written_ns: int) -> Tables:
    with reading(directory.id):
        return read_tables(directory.path)


def _known(argument: str, given: Name, known: Iterable[Any]) -> Name:
    """Return a name if it is known, or raise `UserError` with a hint."""
    names = [each for each in known if each is not None]
    if given not in names:
        hint = did_you_mean(str(given), map(str, names)) if given != "" else f"{len(names)} are known"
        raise UserError(f"{argument}: {hint}, got {str(given)[:100]!r}")
    return given


def _rate(group: "Group") -> dict[str, Any]:
    ends = {"interval": group.interval, "others": group.clustered}
    counts = {name: getattr(group.counts, name) for name in ("passed", "failed", "not_judged")}
    told = {**counts, "configurations": group.configurations, "rate": group.rate}
    return {**told, **{name: each and [each.low, each.high] for name, each in ends.items()}}


def _column(column: Column) -> dict[str, Any]:
    told: dict[str, Any] = {"name": column.name, "group": column.group, "unit": column.unit}
    if meaning := _MEANINGS.get(column.name) or _MEANINGS.get(column.group):
        told["meaning"] = meaning
    if column.levels is not None:
        return {**told, "levels": len(column.levels), "some": [each[:80] for each in column.levels[:MOST_LEVELS]]}
    known = column.values[~column.missing]
    return {**told, "range": [float(f"{end:.6g}") for end in (known.min(), known.max())]} if len(known) else told


def _page(name: str, rows: list[Any], total: int, offset: int, step: str) -> dict[str, Any]:
    left = total - offset - len(rows)
    cut = [f"{left:,} more of {name}: ask on with a greater offset or limit"] * (left > 0)
    return {name: rows, f"total_{name}": total, "cut": cut, "next_step": step}
