"""The commands about floor plans: `floorplan render`, `floorplan geometry` and `floorplan variations`."""

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.terminal.ending import BAD_INPUT, check_writable, writing
from vastflow.flows.terminal.options import command_group
from vastflow.sim.model.faults import UserError

floorplan = command_group("Draw floor plans (.fpm) and their variations (.variation).")

PlanArgument = Annotated[Path, typer.Argument(metavar="FILE.fpm", help="Floor plan.")]
Out = Annotated[Path, typer.Option(help="Folder to write to, created if it does not exist.")]


@floorplan.command()
def render(
    file: PlanArgument,
    out: Out,
    resolution: Annotated[float, typer.Option(min=0.001, help="Cell size of the map (m).")] = 0.05,
    laser_height: Annotated[
        float, typer.Option(min=0.0, help="Height of the laser, where the map is cut (m).")
    ] = 0.193,
) -> None:
    """Write a floor plan's map, mesh and picture.

    maps/NAME.yaml and .pgm, 3d-mesh/NAME.stl, NAME.png, fpm/NAME.fpm and NAME.provenance.json.
    """
    check_writable(out, "--out")
    for option, value in (("--resolution", resolution), ("--laser-height", laser_height)):
        if not math.isfinite(value):
            raise UserError(f"{option}: expected a number of meters, got {value}")
    from vastflow.producers.floorplan.files import read_plan_file
    from vastflow.producers.floorplan.rendering import render as rendered

    plan = read_plan_file(file)
    building = plan.building()
    print(*(f"{note}\n" for note in building.notes), sep="", end="", file=sys.stderr)
    _write(out, rendered(building, plan.text, str(file), resolution, laser_height))


@floorplan.command()
def geometry(file: PlanArgument) -> None:
    """Print all polygons of a floor plan as JSON.

    Spaces, walls, obstacles, and openings in the world frame, in meters.
    """
    from vastflow.producers.floorplan.files import read_plan_file
    from vastflow.producers.floorplan.rendering import geometry_of

    building = read_plan_file(file).building()
    print(*(f"{note}\n" for note in building.notes), sep="", end="", file=sys.stderr)
    print(json.dumps(geometry_of(building)))


@floorplan.command()
def variations(
    file: Annotated[Path, typer.Argument(metavar="FILE.variation", help="Variation file.")],
    out: Out,
    count: Annotated[int, typer.Option(min=1, help="Number of variations.")] = 1,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first variation. The others have the next numbers.")
    ] = 0,
) -> None:
    """Draw variations of a floor plan.

    Each is written as PLAN_SEED.fpm. Variations that make no building are reported and left out. Warnings name what is odd
    in the others, such as a door beside its wall.
    """
    check_writable(out, "--out")
    from vastflow.flows.request.campaign_file import terminal_lines
    from vastflow.producers.floorplan.files import PlanFile, read_variation_file
    from vastflow.producers.floorplan.variation import GREATEST_SEED
    from vastflow.sim.model.faults import FileError

    if seed + count - 1 > GREATEST_SEED:
        raise UserError(f"--seed {seed}: expected a last seed of at most {GREATEST_SEED}, got {seed + count - 1}")
    variation = read_variation_file(file).variation()
    written = 0
    for number in range(seed, seed + count):
        sample = variation.sample(number)
        name = f"{variation.plan.token}_{number}.fpm"
        try:
            building = PlanFile(name, sample.text).building()
        except FileError as error:
            print(f"{file}: not written: {error.brief}", file=sys.stderr)
            continue
        _write(out, {name: sample.text.encode()})
        notes = [replace(note, place=replace(note.place, file=str(out / name))) for note in building.notes]
        for line in terminal_lines(notes):
            print(line, file=sys.stderr)
        written += 1
    if not written:
        raise typer.Exit(BAD_INPUT)


def _write(out: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        place = out / name
        with writing(place, "--out"):
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
        print(place)
