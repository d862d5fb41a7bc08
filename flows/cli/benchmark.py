"""The command `benchmark`: scenes that tell controllers apart, driven with one Nav2 file or with two."""

import json
import shlex
import sys
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from vastflow.flows.cli.init import named, rendered
from vastflow.flows.cli.run import asked_request, computing
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.terminal.ending import FAULT, check_writable, writing
from vastflow.flows.terminal.options import asking
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.results.summary import Results

DOORS_M: Final = (0.4, 0.45, 0.5, 0.6, 0.9)
"""Widths of doors."""
TURNS_M: Final = tuple((radius_m, gap_m) for radius_m in (0.4, 0.8, 1.6) for gap_m in (0.65, 0.8))
"""Radii of the S-turn's walls, and widths of the gap that they leave."""
OPTIONS: Final = ("runs", "results", "store", "workers", "cluster", "only", "force")


@asking(*OPTIONS)
def benchmark(
    params: Annotated[
        list[Path], typer.Option("--params", metavar="NAV2.yaml", help="Nav2 parameter file; a second one is compared.")
    ],
    asked: Mapping[str, Any],
    barn: Annotated[
        Path | None, typer.Option("--barn", metavar="DATA", help="Data of the BARN benchmark, for its worlds too.")
    ] = None,
    until_decided: Annotated[
        bool,
        typer.Option(
            "--until-decided",
            help="With two files, run round by round until B loses or a loss of 2 points is ruled out.",
        ),
    ] = False,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder for the campaign files, which are overwritten.")
    ] = Path("benchmark"),
) -> None:
    """Compare controllers in scenes made for it.

    An office with boxes, doors, people who cross, an S-turn, an open hall, and with --barn the worlds of BARN. Shows how many runs pass in each, with
    intervals, and with two Nav2 files the differences pair by pair and where one loses.
    """
    if len(params) > 2:
        raise UserError(f"--params: expected one file or two, got {len(params)}")
    if until_decided and len(params) == 1:
        raise UserError("--until-decided: requires a second --params")
    check_writable(out)
    names = [file.stem for file in params]
    if len(params) == 2 and names[0] == names[1] and params[0].resolve() != params[1].resolve():
        names[1] += "-b"
    campaigns = [write_campaign(out, name, file, barn) for name, file in zip(names, params, strict=True)]
    if barn is None:
        print("BARN is not run: --barn names no folder with its data")
    requests = [asked_request(campaign, asked) for campaign in campaigns]

    def execute(request: RunRequest) -> "Results":
        with computing(request.force is not None) as display:
            from vastflow.flows import run_campaign

            return run_campaign(request, observer=display)

    from vastflow.flows.analysis.benchmark import benchmark_text, scenes_text
    from vastflow.flows.analysis.comparison import compared
    from vastflow.flows.analysis.until_decided import Side, compared_until_decided
    from vastflow.flows.cli.show import report_line
    from vastflow.flows.terminal.display import print_rows
    from vastflow.oracles.results.tables import read_tables

    found, ended = None, ""
    if until_decided:
        sides = [Side(request) for request in requests]
        found, decision = compared_until_decided(
            sides[0], sides[1], execute, notify=lambda text: print(text, file=sys.stderr)
        )
        ended, tables = decision.text, [found.before, found.after]
    else:
        tables = [read_tables(execute(request).directory) for request in requests]
        found = compared(tables[0], tables[1]) if len(tables) == 2 else None
    for letter, name, each in zip("AB", names, tables, strict=False):
        print(f"\n{letter}  {name}")
        print_rows(benchmark_text(each))
        print(report_line(each.directory))
    if found is not None:
        print("\nB less A, run by run")
        print_rows([*scenes_text(found), *[ended] * until_decided])
        print(f"more: {shlex.join(['vastflow', 'compare', *(str(each.directory) for each in tables)])}")
    if any(each.metadata.get("faults") for each in tables):
        raise typer.Exit(FAULT)


def write_campaign(folder: Path, name: str, nav2_params: Path, barn: Path | None) -> Path:
    """Write the campaign of a Nav2 file with its maps and floor plans, and return its place.

    Raises:
        UserError: the Nav2 file or the data of BARN can't be used, or a file can't be written.
    """
    from vastflow.flows.cli.barn import barn_worlds
    from vastflow.sim.system.keys import FILE_KEY
    from vastflow.sim.system.system import system_kind, system_of

    system = system_of({FILE_KEY: system_kind().file_content(nav2_params)})
    scenes, quickstart = (files(f"vastflow.campaigns.{each}") for each in ("benchmark", "quickstart"))
    doors = {f"width_{100 * width_m:.0f}_cm": {"width": width_m} for width_m in DOORS_M}
    turns = {
        f"radius_{100 * radius_m:.0f}_cm_gap_{100 * gap_m:.0f}_cm": {"radius": radius_m, "gap": gap_m}
        for radius_m, gap_m in TURNS_M
    }
    worlds = {} if barn is None else barn_worlds(barn, 6)
    circles = {f"worlds/world_{number}.csv": world.circles.encode() for number, world in worlds.items()}
    written = {
        each: quickstart.joinpath(each).read_bytes() for each in ("maps/office.yaml", "maps/office.pgm")
    } | circles
    for template, plans in (("hall.fpm", {"hall": {}}), ("door.fpm.j2", doors), ("s_turn.fpm.j2", turns)):
        for plan, sizes in plans.items():
            written[f"{plan}.fpm"] = rendered(scenes.joinpath(template), name=plan, **sizes).encode()
    campaign = folder / f"{name}.vast"
    text = rendered(
        scenes.joinpath("benchmark.vast.j2"),
        command=shlex.quote(str(campaign)),
        name=json.dumps(name, ensure_ascii=False),
        nav2_params=named(nav2_params, folder),
        doors=doors,
        turns=turns,
        worlds=[*circles],
        without_map=_without_map(nav2_params) if system.needs_map else {},
    )
    for each, content in {**written, campaign.name: text.encode()}.items():
        place = folder / each
        with writing(place):
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
    return campaign


def _without_map(nav2_params: Path) -> dict[str, str]:
    """Return parameters of a campaign that take the map from the robot of a Nav2 file."""
    from vastflow.sim.system.system import system_kind

    known = {each.path: each.value for each in system_kind().file_parameters(nav2_params)}
    sizes = {"global_frame": "odom", "width": 40, "height": 40, "origin_x": -20.0, "origin_y": -20.0}
    sizes |= {"track_unknown_space": True}
    found: dict[str, Any] = {
        f"global_costmap.global_costmap.ros__parameters.{name}": value for name, value in sizes.items()
    }
    for costmap in ("local_costmap", "global_costmap"):
        place = f"{costmap}.{costmap}.ros__parameters"
        if isinstance(plugins := known.get(f"{place}.plugins"), list | tuple):
            layers = {str(name): str(known.get(f"{place}.{name}.plugin")) for name in plugins}
            found[f"{place}.plugins"] = [name for name, layer in layers.items() if not layer.endswith("StaticLayer")]
    return {key: json.dumps(value) for key, value in found.items()}
