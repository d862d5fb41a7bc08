"""Drive five robots with Nav2 files of their own, and check that each contact is recorded.

    python docs/studies/five_robots.py [--paths 3] [--runs 2] [--robots NAME...]

A body that overlaps a wall's cells by more than a centimeter in the recorded true poses must have had a contact; exits with 1 where one
has not.
"""

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import shapely
import shapely.affinity
from missions import parser_of

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.places.ground import touched_cells
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.recording import Recording
from vastflow.sim.reading.checked import checked_of
from vastflow.sim.run import run
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Robot

FOLDER: Final = Path(__file__).parents[2] / "campaigns" / "robots"
ROBOTS: Final = ("turtlebot3_burger", "turtlebot3_waffle", "turtlebot4", "rectangle", "forklift")
OVERLAP_M: Final = 0.01
COLUMNS: Final = ("robot", "floor", "runs", "arrived", "with a contact", "overlap without a contact")
SOON_S: Final = 0.1
"""A row is recorded this often."""


def body_of(robot: Robot) -> shapely.Polygon:
    """The body, shrunk by the tolerated overlap."""
    whole = shapely.Polygon(robot.vertices) if robot.vertices else shapely.Point(0.0, 0.0).buffer(robot.radius_m)
    return whole.buffer(-OVERLAP_M)


def is_unnoted(recording: Recording, body: shapely.Polygon, occupancy: OccupancyMap) -> bool:
    """Whether a recorded pose puts the body into a wall without a contact until then."""
    contacts = [event.t_s for event in recording.run.events if event.kind == "contact"]
    first_s = min(contacts, default=math.inf)
    columns = (recording.columns[name].tolist() for name in ("t_ms", "x_mm", "y_mm", "yaw_mrad"))
    for t_ms, x_mm, y_mm, yaw_mrad in zip(*columns, strict=True):
        if t_ms * 1e-3 + SOON_S >= first_s:
            return False
        turned = shapely.affinity.rotate(body, yaw_mrad * 1e-3, origin=(0.0, 0.0), use_radians=True)
        if _is_in_a_wall(shapely.affinity.translate(turned, x_mm * 1e-3, y_mm * 1e-3), occupancy):
            return True
    return False


def _is_in_a_wall(area: shapely.Polygon, occupancy: OccupancyMap) -> bool:
    """Whether an area, convex or not, overlaps an occupied cell of a map that is not turned."""
    cells = touched_cells(occupancy, area.convex_hull)
    cells = cells[occupancy.occupied[cells[:, 0], cells[:, 1]]]
    (x_m, y_m), size_m = occupancy.origin_xy_m, occupancy.resolution_m
    left, below = x_m + cells[:, 1] * size_m, y_m + cells[:, 0] * size_m
    return bool(shapely.intersects(area, shapely.box(left, below, left + size_m, below + size_m)).any())


def rows_of(name: str, paths: int, runs: int) -> Iterator[tuple[str | int, ...]]:
    """A row of the table for each floor of a robot's campaign, of its first paths."""
    campaign = load_campaign(FOLDER / f"{name}.vast")
    found = [each for each in instantiate(campaign).configurations if each.duplicate_of is None]
    for family in campaign.families:
        counts = []
        for each in [each for each in found if each.family == family.name][:paths]:
            setup = checked_of(each.scenario).robot
            assert setup is not None
            assert isinstance(setup.map_file, FileContent)
            body, occupancy = body_of(setup.robot), load_map(setup.map_file.path)
            for recording in (run(each.scenario, k, campaign.seed) for k in range(runs)):
                contact = any(event.kind == "contact" for event in recording.run.events)
                arrived = recording.run.outcome == "succeeded"
                counts.append((1, arrived, contact, is_unnoted(recording, body, occupancy)))
        yield name, family.name, *np.sum(counts, axis=0).tolist()


def main() -> None:
    """Print the table of a robot as soon as it is known."""
    parser = parser_of(__doc__)
    parser.add_argument("--paths", type=int, default=3)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=ROBOTS)
    options = parser.parse_args()
    unnoted = 0
    for name in options.robots:
        found = pd.DataFrame(rows_of(name, options.paths, options.runs), columns=COLUMNS)
        unnoted += found[COLUMNS[-1]].sum()
        print(found.to_string(index=False), flush=True)
    sys.exit(1 if unnoted else 0)


if __name__ == "__main__":
    main()
