"""The command `preview`: a campaign instantiated, counted and drawn, and nothing of it executed."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vastflow.flows.terminal.interruptible import Interruptible
from vastflow.flows.terminal.options import AsJson, AsV1, CampaignFile, MapDir
from vastflow.flows.terminal.writing import check_writable, writing

if TYPE_CHECKING:
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
        from vastflow.flows.computing.processors import cores
        from vastflow.flows.plan.estimate import estimate_of
        from vastflow.flows.plan.preview import preview_json, preview_text
        from vastflow.flows.request.campaign_file import campaign_name, read_campaign
        from vastflow.flows.results.directory import directory_name
        from vastflow.producers.instantiation.instantiate import instantiate
        from vastflow.sim.plug_ins.effects import looking_only

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
