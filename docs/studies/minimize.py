"""Planted failures: does `vastflow minimize` end at what was planted, and at nothing that does not fail?

    python docs/studies/minimize.py [NAME …]

Each plant is a scenario of two rooms with a door between them, in which one thing or two make the robot fail among others that do
not. The cause that is found is right where it is what was planted, no more and no less.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from vastflow.flows import run_campaign
from vastflow.flows.analysis.failing import NotMinimized
from vastflow.flows.analysis.minimize import minimize_configuration

TIMEOUT_S = 45
RUNS = 3


@dataclass(frozen=True)
class Plant:
    """A scenario that fails.

    Attributes:
        values: Values of its family's parameters, beside the map.
        cause: Elements that its failure needs, each as the beginning of its description.
    """

    name: str
    values: Mapping[str, Any]
    cause: frozenset[str]


def box(name: str, x: float, y: float, size: float = 0.4, **more: Any) -> dict[str, Any]:
    arguments = f"width:={size}, length:={size}, height:=1.0"
    return {
        "entity_name": name,
        "model": "box",
        "spawn_pose": {"x": x, "y": y, "yaw": 0.0},
        "xacro_arguments": arguments,
        **more,
    }


HARMLESS = [box("a", 1.5, 0.6), box("b", 1.5, 4.4), box("c", 4.4, 0.6), box("d", 4.4, 4.4), box("e", 0.5, 3.5)]
START, GOAL = {"x": 1.0, "y": 2.5, "yaw": 0.0}, {"x": 5.0, "y": 2.5, "yaw": 0.0}
NOISE, DROP = "laserscan_gaussian_noise_std_deviation", "laserscan_random_drop_percentage"


def plant(name: str, *cause: str, boxes: Sequence[Mapping[str, Any]] = (), **values: Any) -> Plant:
    given = {"start_pose": START, "goal_pose": GOAL, "static_objects": [*HARMLESS[:3], *boxes, *HARMLESS[3:]], **values}
    return Plant(name, given, frozenset(cause))


APPEARS = {"point": {"x": 2.0, "y": 2.5}, "threshold": 0.5}
PLANTS = (
    plant("door", "obstacle door", boxes=[box("door", 3.0, 2.5, 1.0)], **{NOISE: 0.02}),
    plant("pair", "obstacle left", "obstacle right", boxes=[box("left", 3.0, 2.8, 0.5), box("right", 3.0, 2.2, 0.5)]),
    plant("on-goal", "obstacle parked", boxes=[box("parked", 5.0, 2.5, 0.6)], **{NOISE: 0.02}),
    plant("appears", "obstacle sudden", boxes=[box("sudden", 3.0, 2.5, 1.0, spawn_trigger=APPEARS)], **{NOISE: 0.02}),
    plant("noise", NOISE, boxes=[box("f", 2.0, 1.5)], **{NOISE: 2.0, DROP: 0.1}),
    plant("wide", "robot_radius", robot_radius=0.6, **{NOISE: 0.02}),
    plant("slow", "vx_max", vx_max=0.03, **{NOISE: 0.02, "xy_goal_tolerance": 0.3}),
    plant("chamber", "waypoint 2", goal_poses=[{"x": 2.2, "y": 3.2}, {"x": 5.3, "y": 0.5}, {"x": 4.4, "y": 3.2}, GOAL]),
    plant("gap", "obstacle narrow", "robot_radius", boxes=[box("narrow", 3.0, 2.8, 0.5)], robot_radius=0.32),
    plant("walls", "moved walls", world={"seed": 5, "wall_offset": 0.8, "correlation_length": 1.0}, **{NOISE: 0.02}),
)


def two_rooms(columns: int) -> NDArray[np.uint8]:
    """Gray values of two rooms, in cells of 5 cm, with a wall between them."""
    cells = np.full((100, columns), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[:, 59:61] = 0
    return cells


def map_of(cells: NDArray[np.uint8], file: Path) -> None:
    Image.fromarray(cells).save(file.with_suffix(".pgm"))
    file.write_text(f"{{image: {file.stem}.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}}\n")


def written(folder: Path, plants: Sequence[Plant]) -> Path:
    """The campaign file with a family for each plant."""
    cells = two_rooms(120)
    cells[39:61, 59:61] = 254  # a door of 1.1 m
    cells[80:82, 95:] = cells[80:, 95:97] = 0  # a chamber without a door
    map_of(cells, folder / "rooms.yaml")
    families = []
    for each in plants:
        values = {"map_file": "rooms.yaml", **each.values}
        if "goal_poses" in values:
            del values["goal_pose"]
        families.append({"name": each.name, "parameters": [{key: values[key]} for key in values]})
    data = {"version": 1, "metadata": {"name": "planted"}, "configuration": families}
    data["execution"] = {"runs": RUNS, "timeout": TIMEOUT_S}
    (folder / "planted.vast").write_text(yaml.safe_dump(data, sort_keys=False))
    return folder / "planted.vast"


def main(names: Sequence[str]) -> int:
    plants = [each for each in PLANTS if not names or each.name in names]
    right = wrong_failures = runs = 0
    with TemporaryDirectory() as place:
        folder, store = Path(place), Path(place, "store")
        directory = run_campaign(written(folder, plants), results=folder / "results", store=store).directory
        for each in plants:
            cause: list[str] = []
            said, spent, is_wrong = "nothing that fails", 0, False
            try:
                found = minimize_configuration(directory, each.name, store=store)
            except NotMinimized as error:
                print(error)
            else:
                confirmed = found.minimum.confirmation
                cause, spent = [what.text for what in found.minimum.without], found.runs
                fails = confirmed.failed / confirmed.judged
                said, is_wrong = f"{fails:.0%} of the confirming runs fail", fails < 0.5
            named = {planted for planted in each.cause if any(what.startswith(planted) for what in cause)}
            is_right = named == each.cause and len(cause) == len(each.cause)
            right, wrong_failures, runs = right + is_right, wrong_failures + is_wrong, runs + spent
            verdict = "planted" if is_right else "NOT WHAT WAS PLANTED"
            print(f"{each.name:8} {verdict}: {'; '.join(cause)}; {said}; {spent} runs", flush=True)
    print(f"{right} of {len(plants)} end at what was planted, {wrong_failures} at what does not fail; {runs} runs")
    return 0 if right >= 0.9 * len(plants) and not wrong_failures else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="of plants; else all")
    sys.exit(main(parser.parse_args().names))
