"""The command `calibrate`: a robot's noise, dead time, and lag from its bags, as a section of a campaign file."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.cli.import_bag import pose_of
from vastflow.flows.terminal.options import AsJson
from vastflow.sim.model.faults import UserError


def calibrate(
    bags: Annotated[list[Path], typer.Argument(metavar="BAG...", help="Bags: folders, .mcap, .db3, or .bag files.")],
    map_file: Annotated[Path | None, typer.Option("--map", metavar="YAML", help="The map that the robot had.")] = None,
    namespace: Annotated[str, typer.Option(help="The robot's namespace, such as robot1.")] = "",
    lidar: Annotated[
        str | None, typer.Option(metavar="X,Y,YAW", help="Pose of the lidar on the robot, where the bag lacks it.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit a robot's lidar noise, odometry noise, dead time, and lag to its bags.

    Prints a section `robot:` for a family of a campaign file, with 99 % intervals; what the simulator has no key for is a comment.
    """
    from vastflow.flows.bags.calibration import calibrate as fit
    from vastflow.flows.bags.calibration import section_of
    from vastflow.sim.world.world import map_content, read_grid

    mount = pose_of(lidar, "--lidar")
    try:
        ground = None if map_file is None else read_grid(map_content(map_file))
    except ValueError as error:
        raise UserError(f"--map: {error}") from None
    found = fit(bags, ground, namespace, None if mount is None else (mount.x_m, mount.y_m, mount.yaw_rad))
    print(json.dumps(asdict(found)) if as_json else section_of(found))
