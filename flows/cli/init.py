"""The command `init`: a first campaign, the quickstart or one for the user's map and robot."""

import json
import math
import os
import shlex
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.terminal.ending import check_writable, writing
from vastflow.sim.model.faults import UserError

_LONGEST_PATH_M: Final = 10.0
_SHORTEST_PATH_M: Final = 1.0
_TEMPLATE: Final = Path(__file__).with_name("random_paths.vast.j2")
_BARN_TEMPLATE: Final = Path(__file__).with_name("barn.vast.j2")
_BARN: Final = "barn"


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to write to, created if it does not exist.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="MAP.yaml", help="Map of map_server, for random paths on it.")
    ] = None,
    nav2_params: Annotated[
        Path | None,
        typer.Option("--params", metavar="NAV2.yaml", help="With --map or --worlds: the robot's Nav2 parameter file."),
    ] = None,
    worlds: Annotated[
        Path | None, typer.Option("--worlds", metavar="DATA", help="Data of the BARN benchmark, for its campaign.")
    ] = None,
    every: Annotated[int, typer.Option("--every", min=1, help="With --worlds: take every n-th of its 300 worlds.")] = 6,
) -> None:
    """Write a first campaign.

    With a map, it drives random paths on that map with the robot of the Nav2 parameter file, or of Nav2's default file; both
    files stay where they are. `vastflow init barn` with the data of the BARN benchmark and a Nav2 file without a map writes that
    benchmark's campaign. Without any, it is the quickstart: 24 configurations of a delivery robot in a small office.
    Existing files are never overwritten.
    """
    is_barn = worlds is not None or (folder.name == _BARN and map_file is None)
    if nav2_params is not None and map_file is None and not is_barn:
        raise UserError("--params: requires --map or --worlds")
    check_writable(folder)
    stem = _BARN if is_barn else "quickstart" if map_file is None else map_file.stem
    name = f"{stem}.vast"
    campaign = folder / name
    command = shlex.quote(str(campaign))
    if is_barn:
        written = _barn(folder, worlds, map_file, nav2_params, every, command)
    elif map_file is None:
        quickstart = files("vastflow.campaigns.quickstart")
        text = quickstart.joinpath(name).read_text(encoding="utf-8").replace(f"campaigns/quickstart/{name}", command)
        maps = {each: quickstart.joinpath(each).read_bytes() for each in ("maps/office.yaml", "maps/office.pgm")}
        written = {name: text.encode(), **maps}
    else:
        written = {name: _random_paths(folder, map_file, nav2_params, command).encode()}
    if taken := [str(folder / each) for each in written if os.path.lexists(folder / each)]:
        raise UserError(f"{', '.join(taken)}: There already. Name another folder.")
    for each, content in written.items():
        place = folder / each
        with writing(place):
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
    beside = " and its worlds" if is_barn else " and its map" if map_file is None else ""
    print(f"wrote {campaign}{beside}, now run it:")
    print(f"vastflow run {command}")


def _barn(
    folder: Path, data: Path | None, map_file: Path | None, nav2_params: Path | None, every: int, command: str
) -> dict[str, bytes]:
    from vastflow.flows.cli.barn import NAV2_SOURCE, SOURCE, barn_worlds
    from vastflow.sim.system.keys import FILE_KEY
    from vastflow.sim.system.system import system_kind, system_of

    if data is None:
        raise UserError(f"--worlds: expected a folder with the data of BARN, such as a clone of {SOURCE}, got none")
    if nav2_params is None or map_file is not None:
        raise UserError(f"--worlds: requires --params, a Nav2 file without a map such as {NAV2_SOURCE}, and no --map")
    if system_of({FILE_KEY: system_kind().file_content(nav2_params)}).needs_map:
        what = "expected a robot that drives without a map: global_costmap in odom without a static layer"
        raise UserError(f"{nav2_params}: {what}, such as {NAV2_SOURCE}")
    worlds = barn_worlds(data, every)
    text = _rendered(
        _BARN_TEMPLATE,
        command=command,
        worlds=[(number, round(world.length_m, 3)) for number, world in worlds.items()],
        nav2_params=_named(nav2_params, folder),
    )
    circles = {f"worlds/world_{number}.csv": world.circles.encode() for number, world in worlds.items()}
    return {f"{_BARN}.vast": text.encode(), **circles}


def _random_paths(folder: Path, map_file: Path, nav2_params: Path | None, command: str) -> str:
    from vastflow.producers.places.ground import ground_of
    from vastflow.producers.places.route import farthest_m
    from vastflow.sim.model.polygon import circumscribed_radius_m
    from vastflow.sim.system.keys import FILE_KEY
    from vastflow.sim.system.system import system_kind, system_of
    from vastflow.sim.world.readers.reader import WorldError
    from vastflow.sim.world.world import map_content

    try:
        file = {} if nav2_params is None else {FILE_KEY: system_kind().file_content(nav2_params)}
        diameter_m = math.ceil(200 * circumscribed_radius_m(system_of(file).start_outline)) / 100
        ground = ground_of(map_content(map_file), diameter_m, diameter_m / 2)
    except WorldError as error:
        raise UserError(str(error)) from None
    # From any place in the largest area some place is at least half as far as the two that are farthest apart.
    largest = ground.cells[ground.component_cells.argmax()] if len(ground.cells) else None
    length_m = (
        0.0 if largest is None else min(farthest_m(ground, (int(largest[0]), int(largest[1]))) / 2, _LONGEST_PATH_M)
    )
    if length_m < _SHORTEST_PATH_M:
        asked = f"paths of {_SHORTEST_PATH_M:g} m on which {ground.robot_text} can turn"
        raise UserError(f"{map_file}: expected {asked}, got none")
    length_m = math.floor(10 * length_m) / 10

    return _rendered(
        _TEMPLATE,
        command=command,
        name=json.dumps("-".join(file.stem for file in (map_file, nav2_params) if file), ensure_ascii=False),
        map_file=_named(map_file, folder),
        length_m=f"{length_m:g}",
        tolerance_m=f"{length_m / 10:.2g}",
        diameter_m=f"{diameter_m:g}",
        nav2_params="" if nav2_params is None else f"nav2_params: {_named(nav2_params, folder)}\n  ",
    )


def _named(file: Path, folder: Path) -> str:
    return json.dumps(Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix(), ensure_ascii=False)


def _rendered(template: Path, **values: object) -> str:
    from jinja2 import Template

    text: str = Template(template.read_text(encoding="utf-8"), keep_trailing_newline=True).render(**values)
    return text
