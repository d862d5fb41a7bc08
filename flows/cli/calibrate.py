"""The command `calibrate`: a robot's noise, dead time, and lag from its bags, as a section of a campaign file."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.terminal.options import AsJson


def calibrate(
    bags: Annotated[list[Path], typer.Argument(metavar="BAG...", help="Bags: folders, .mcap, .db3, or .bag files.")],
    namespace: Annotated[str, typer.Option(help="The robot's namespace, such as robot1.")] = "",
    as_json: AsJson = False,
) -> None:
    """Fit a robot's lidar noise, odometry noise, dead time, and lag to its bags.

    Prints a section `robot:` for a family of a campaign file, with 99 % intervals; what the simulator has no key for is a comment.
    """
    from vastflow.flows.bags.calibration import calibrate as fit
    from vastflow.flows.bags.calibration import section_of

    found = fit(bags, namespace)
    print(json.dumps(asdict(found)) if as_json else section_of(found))
