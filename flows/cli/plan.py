"""The commands `preview`, `coverage`, and `explain`: what a campaign would run, and why, with nothing executed."""

import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from vastflow.flows.results.address import check_directory, meant_address
from vastflow.flows.terminal.ending import Interruptible, check_writable, writing
from vastflow.flows.terminal.options import AsJson, AsV1, CampaignFile, MapDir, ResultsFolder
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from vastflow.oracles.results.coverage import Coverage, Covered
    from vastflow.producers.model.configuration import Configuration


def preview(
    file: CampaignFile,
    pictures: Annotated[int, typer.Option(min=0, metavar="N", help="Draw the first N configurations.")] = 4,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where pictures are written; else preview-NAME.")
    ] = None,
    map_dir: MapDir = None,
    as_v1: AsV1 = False,
    as_json: AsJson = False,
) -> None:
    """Show what a campaign would run, without running it.

    Configurations, what is rejected or excluded and why, an estimate of the time, and pictures.
    """
    with Interruptible("interrupted"):
        from vastflow.flows.plan.preview import estimate_of, preview_json, preview_text
        from vastflow.flows.request.campaign_file import campaign_name, read_campaign
        from vastflow.flows.results.directory import directory_name
        from vastflow.producers.instantiation.instantiate import instantiate
        from vastflow.sim.plug_ins.effects import looking_only
        from vastflow.tasks.engine.pool import cores

        with looking_only():
            campaign, _ = read_campaign(file, map_dir, as_v1=as_v1)
        folder = out or Path(f"preview-{directory_name(campaign_name(campaign))}")
        if pictures:
            check_writable(folder, "--out")
        with looking_only():
            found = instantiate(campaign)
        for fault in campaign.unexecutable:
            print(f"not to be run by this version: {fault}", file=sys.stderr)
        for fault in campaign.missing:
            print(f"left out: {fault}", file=sys.stderr)
        estimate = estimate_of(found.configurations, campaign.runs, campaign.timeout_s, cores())
        least = None if campaign.sequential is None else campaign.sequential.min
        if not as_json:
            from vastflow.flows.terminal.outcome import printed

            printed(preview_text(found.coverage, campaign.runs, estimate, least))
        distinct = [configuration for configuration in found.configurations if configuration.duplicate_of is None]
        with writing(folder, "--out"):
            written = _drawn(distinct[:pictures], folder)
        if as_json:
            print(json.dumps(preview_json(found.coverage, campaign.runs, estimate, [*map(str, written)])))
        elif written:
            print("\npictures:")
            for picture in written:
                print(picture)


def _drawn(configurations: "Sequence[Configuration]", folder: Path) -> list[Path]:
    """The pictures of these configurations; one that can't be drawn is named on standard error."""
    from vastflow.flows.plan.preview import plan_view_of
    from vastflow.oracles.figures.picture import png
    from vastflow.oracles.figures.plan_view import plan_view_figure

    written = []
    for configuration in configurations:
        try:
            view = plan_view_of(configuration)
        except ValueError as error:
            print(f"not drawn: {configuration.name}: {error}", file=sys.stderr)
            continue
        folder.mkdir(parents=True, exist_ok=True)
        picture = folder / f"{configuration.name}.png"
        picture.write_bytes(png(plan_view_figure(view)))
        written.append(picture)
    return written


MOST_PAIRS: Final = 30
"""Pairs of producers in the terminal, the least covered of each family first; `--json` has more."""


def coverage(
    source: Annotated[Path, typer.Argument(metavar="FILE|RESULTS", help="A campaign file, or a campaign directory.")],
    map_dir: MapDir = None,
    as_v1: AsV1 = False,
    as_json: AsJson = False,
) -> None:
    """Show how much of the requested test space is realised.

    And what constraints exclude, what can't be built and why, by dimension and by pairs of producers.
    """
    with Interruptible("interrupted"):
        found = _coverage(source, map_dir, as_v1)
        if as_json:
            print(json.dumps(found, ensure_ascii=False))
            return
        from vastflow.flows.terminal.outcome import printed

        with reading(source):
            printed(_text(found))


def _coverage(source: Path, map_dir: Path | None, as_v1: bool) -> "Coverage":
    """Of a campaign directory as it was written, of a campaign file by instantiating it."""
    from vastflow.flows.request.campaign_file import read_campaign
    from vastflow.oracles.results.coverage import read_coverage
    from vastflow.producers.instantiation.instantiate import instantiate
    from vastflow.sim.plug_ins.effects import looking_only

    if source.is_dir() or meant_address(source):
        check_directory(source)
        with reading(source):
            try:
                return read_coverage(source)
            except FileNotFoundError:
                what = "has no coverage.json; an earlier version wrote it, run the campaign again"
                raise UnusableDirectory(f"{source}: {what}") from None
    if not source.exists():
        raise UserError(f"{source}: no such file or folder; a campaign file, or a folder that `vastflow run` wrote")
    with looking_only():
        campaign, _ = read_campaign(source, map_dir, as_v1=as_v1)
        for fault in campaign.missing:
            print(f"left out: {fault}", file=sys.stderr)
        return instantiate(campaign).coverage


def _text(coverage: "Coverage") -> "Iterator[RenderableType]":
    from rich.text import Text

    from vastflow.flows.plan.preview import lost_table
    from vastflow.flows.terminal.table import terminal_table
    from vastflow.oracles.results.coverage import (
        COUNTS,
        counts,
        design_text,
        dimensions,
        excluded,
        pairs,
        pairs_not_listed,
        parts,
        unrealisable,
    )

    whole = terminal_table(("family",), (*COUNTS, "share"), ("design",))
    for name, part in parts(coverage):
        design = design_text(part["design"]) if "design" in part else ""
        whole.add_row(name, *(f"{n:,}" for n in counts(part)), share_text(part["share"]), design)
    yield whole
    for title, lost in (("excluded by constraints", excluded), ("unrealisable", unrealisable)):
        if rows := list(lost(coverage)):
            yield ""
            yield Text(title, "bold")
            yield lost_table(rows)
    yield ""
    yield _covered_table("dimension", list(dimensions(coverage)))
    if listed := list(pairs(coverage)):
        yield ""
        yield _covered_table("pair of producers", listed[:MOST_PAIRS])
        if rest := len(listed) - len(listed[:MOST_PAIRS]) + pairs_not_listed(coverage):
            yield Text(f"and {rest:,} more pairs; --json lists more", "dim")


def _covered_table(what: str, rows: "Sequence[Covered]") -> "Table":
    from vastflow.flows.terminal.table import terminal_table

    with_contents = any(row.distinct is not None for row in rows)
    table = terminal_table(
        ("family", what),
        (*["contents"][:with_contents], "choices", "admissible", "covered", "share"),
        ["written by"][:with_contents],
    )
    for row in rows:
        numbers = (*[row.distinct or 0][:with_contents], row.combinations, row.admissible, row.covered)
        by = [", ".join(row.factors) or "–"][:with_contents]
        table.add_row(row.family, row.what, *(f"{n:,}" for n in numbers), share_text(row.share), *by)
    return table


def share_text(share: float | None) -> str:
    """A share for people, rounded down, so that only what is whole is 100 %."""
    if share is None:
        return "–"
    if 0.0 < share < 0.001:
        return "< 0.1 %"
    return f"{math.floor(share * 1000 + 1e-9) / 10:.1f} %"


def explain(
    results: ResultsFolder,
    configuration: Annotated[str, typer.Argument(metavar="CONFIGURATION", help="Name of a configuration.")],
    since: Annotated[
        Path | None, typer.Option(metavar="RESULTS", help="Compare with this campaign, else with the one before.")
    ] = None,
    store: Annotated[
        str | None, typer.Option(help="Store: a folder or an address; else $VASTFLOW_STORE, else a user cache folder.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say where a configuration came from, and what a run of it would compute today and why.

    Its scenario in three dimensions with the producer that wrote each value, its digest, the keys of its results and
    which of them are in the store, and what is other in an earlier campaign.
    """
    check_directory(results)
    if since is not None:
        check_directory(since, "--since")
    with Interruptible("interrupted"):
        from vastflow.flows.plan.explain import explained, explanation_json, explanation_text
        from vastflow.flows.terminal.outcome import printed

        with reading(results):
            found = explained(results, configuration, store=store, since=since)
            if as_json:
                print(json.dumps(explanation_json(found), ensure_ascii=False))
            else:
                printed(explanation_text(found))
