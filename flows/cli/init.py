"""The command `init`: a first campaign, the quickstart or one for the user's map and robot."""

import json
import math
import os
import shlex
from collections.abc import Callable
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.terminal.ending import check_writable, writing
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import UserError

_LONGEST_PATH_M: Final = 10.0
_SHORTEST_PATH_M: Final = 1.0
_TEMPLATE: Final = Path(__file__).with_name("random_paths.vast.j2")
_BARN_TEMPLATE: Final = Path(__file__).with_name("barn.vast.j2")
_WORLDS_TEMPLATE: Final = Path(__file__).with_name("worlds.vast.j2")
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
        Path | None,
        typer.Option(
            "--worlds", metavar="DATA", help="Folder of maps and Gazebo worlds, or data of the BARN benchmark."
        ),
    ] = None,
    every: Annotated[int, typer.Option("--every", min=1, help="Of BARN's 300 worlds take every n-th.")] = 6,
) -> None:
    """Write a first campaign.

    With a map, it drives random paths on that map with the robot of the Nav2 parameter file, or of Nav2's default file; both
    files stay where they are. `--worlds` takes a folder of maps and Gazebo worlds instead, such as the MRPB benchmark's, or with a Nav2
    file without a map the data of the BARN benchmark. Without any, it is the quickstart: 24 configurations of a delivery robot in a
    small office. Existing files are never overwritten.
    """
    is_barn = folder.name == _BARN and (map_file is None or worlds is not None)
    if worlds is not None and not is_barn:
        from vastflow.flows.cli.barn import has_barn

        is_barn = has_barn(worlds)
    if nav2_params is not None and map_file is None and worlds is None and not is_barn:
        raise UserError("--params: requires --map or --worlds")
    check_writable(folder)
    if is_barn:
        stem = _BARN
    elif worlds is not None:
        from vastflow.flows.cli.worlds import slug

        stem = slug(folder.resolve().name)
    else:
        stem = "quickstart" if map_file is None else map_file.stem
    name = f"{stem}.vast"
    campaign = folder / name
    command = shlex.quote(str(campaign))
    if is_barn:
        written = _barn(folder, worlds, map_file, nav2_params, every, command)
    elif worlds is not None:
        if map_file is not None:
            raise UserError("--worlds: expected no --map beside it, got both")
        written = _worlds(folder, worlds, nav2_params, command, stem)
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
    beside = " and its worlds" if is_barn else " and its map" if map_file is None and worlds is None else ""
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
    text = rendered(
        _BARN_TEMPLATE,
        command=command,
        worlds=[(number, round(world.length_m, 3)) for number, world in worlds.items()],
        nav2_params=named(nav2_params, folder),
    )
    circles = {f"worlds/world_{number}.csv": world.circles.encode() for number, world in worlds.items()}
    return {f"{_BARN}.vast": text.encode(), **circles}


def _worlds(folder: Path, data: Path, nav2_params: Path | None, command: str, stem: str) -> dict[str, bytes]:
    """Return the campaign of a folder's places, and maps of worlds that have none for a robot that needs one."""
    from vastflow.flows.cli.worlds import places_in
    from vastflow.flows.results.results import map_files
    from vastflow.sim.world.world import read_grid, world_content

    robot = _Robot(nav2_params)
    found, left_out = places_in(data)
    places: list[dict[str, object]] = []
    written: dict[str, bytes] = {}
    for place in found:
        ground = place.map_file or place.world
        assert ground is not None
        row: dict[str, object] = {"name": place.name, "trips": place.trips, "movers": place.movers}
        try:
            if not place.trips:
                row |= robot.path_on(ground, world_content)
        except UserError as error:
            left_out.append(str(error))
            continue
        if place.map_file is not None:
            row["map_file"] = named(place.map_file, folder)
        elif robot.system.needs_map:
            row["map_file"] = f"maps/{place.name}/map.yaml"
            for name, content in map_files(read_grid(world_content(ground))).items():
                written[f"maps/{place.name}/{name}"] = content
        row["world"] = place.world and named(place.world, folder)
        places.append(row)
    for sentence in left_out:
        print(f"left out: {sentence}")
    if not places:
        raise UserError(f"{data}: expected a place for a robot {robot.diameter_m:g} m across, got: {left_out[-1]}")
    text = rendered(
        _WORLDS_TEMPLATE,
        command=command,
        name=stem,
        places=places,
        diameter_m=f"{robot.diameter_m:g}",
        nav2_params=_nav2_line(nav2_params, folder),
    )
    return {f"{stem}.vast": text.encode(), **written}


def _random_paths(folder: Path, map_file: Path, nav2_params: Path | None, command: str) -> str:
    from vastflow.sim.world.world import map_content

    robot = _Robot(nav2_params)
    return rendered(
        _TEMPLATE,
        command=command,
        name=json.dumps("-".join(file.stem for file in (map_file, nav2_params) if file), ensure_ascii=False),
        map_file=named(map_file, folder),
        diameter_m=f"{robot.diameter_m:g}",
        nav2_params=_nav2_line(nav2_params, folder),
        **robot.path_on(map_file, map_content),
    )


class _Robot:
    """The robot of a Nav2 parameter file, or of Nav2's default file.

    Attributes:
        diameter_m: Diameter of the disc in which it turns.
    """

    def __init__(self, nav2_params: Path | None) -> None:
        from vastflow.sim.model.polygon import circumscribed_radius_m
        from vastflow.sim.system.keys import FILE_KEY
        from vastflow.sim.system.system import system_kind, system_of

        self.system = system_of({} if nav2_params is None else {FILE_KEY: system_kind().file_content(nav2_params)})
        self.diameter_m = math.ceil(200 * circumscribed_radius_m(self.system.start_outline)) / 100

    def path_on(self, file: Path, content: Callable[[Path], FileContent]) -> dict[str, str]:
        """Return length and tolerance of paths that it can drive on a map or in a world.

        Raises:
            UserError: the file can't be read, or there are none.
        """
        from vastflow.producers.places.ground import ground_of
        from vastflow.producers.places.route import farthest_m
        from vastflow.sim.world.readers.reader import WorldError

        try:
            ground = ground_of(content(file), self.diameter_m, self.diameter_m / 2)
        except WorldError as error:
            raise UserError(str(error)) from None
        # From any place in the largest area some place is at least half as far as the two that are farthest apart.
        largest = ground.cells[ground.component_cells.argmax()] if len(ground.cells) else None
        length_m = (
            0.0 if largest is None else min(farthest_m(ground, (int(largest[0]), int(largest[1]))) / 2, _LONGEST_PATH_M)
        )
        if length_m < _SHORTEST_PATH_M:
            asked = f"paths of {_SHORTEST_PATH_M:g} m on which {ground.robot_text} can turn"
            raise UserError(f"{file}: expected {asked}, got none")
        length_m = math.floor(10 * length_m) / 10
        return {"length_m": f"{length_m:g}", "tolerance_m": f"{length_m / 10:.2g}"}


def _nav2_line(nav2_params: Path | None, folder: Path) -> str:
    return "" if nav2_params is None else f"nav2_params: {named(nav2_params, folder)}\n  "


def named(file: Path, folder: Path) -> str:
    """Return the quoted path of a file as a campaign file in a folder names it."""
    return json.dumps(Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix(), ensure_ascii=False)


def rendered(template: Traversable, **values: object) -> str:
    """Return the text of a template with these values."""
    from jinja2 import Template

    text: str = Template(template.read_text(encoding="utf-8"), keep_trailing_newline=True).render(**values)
    return text
