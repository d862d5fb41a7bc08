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


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to write to, created if it does not exist.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="MAP.yaml", help="Map of map_server, for random paths on it.")
    ] = None,
    nav2_params: Annotated[
        Path | None, typer.Option("--params", metavar="NAV2.yaml", help="With --map: the robot's Nav2 parameter file.")
    ] = None,
) -> None:
    """Write a first campaign.

    With a map, it drives random paths on that map with the robot of the Nav2 parameter file, or of Nav2's default file; both
    files stay where they are. Without a map, it is the quickstart: 24 configurations of a delivery robot in a small office.
    Existing files are never overwritten.
    """
    if nav2_params is not None and map_file is None:
        raise UserError("--params: requires --map")
    check_writable(folder)
    name = "quickstart.vast" if map_file is None else f"{map_file.stem}.vast"
    campaign = folder / name
    command = shlex.quote(str(campaign))
    if map_file is None:
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
    print(f"wrote {campaign}{' and its map' if map_file is None else ''}, now run it:")
    print(f"vastflow run {command}")


def _random_paths(folder: Path, map_file: Path, nav2_params: Path | None, command: str) -> str:
    from jinja2 import Template

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

    def named(file: Path) -> str:
        return json.dumps(Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix(), ensure_ascii=False)

    text: str = Template(_TEMPLATE.read_text(encoding="utf-8"), keep_trailing_newline=True).render(
        command=command,
        name=json.dumps("-".join(file.stem for file in (map_file, nav2_params) if file), ensure_ascii=False),
        map_file=named(map_file),
        length_m=f"{length_m:g}",
        tolerance_m=f"{length_m / 10:.2g}",
        diameter_m=f"{diameter_m:g}",
        nav2_params="" if nav2_params is None else f"nav2_params: {named(nav2_params)}\n  ",
    )
    return text
