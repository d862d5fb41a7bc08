"""On each of the paper's five maps: random paths, several runs each, without noise or obstacles.

Prints a table for each length with a line a map, and every failure with its reason and where it happened. A length that a map
has no path of is said and left out. Exit code 1 when a map falls below 95 % of missions or the median true final
distance to the goal exceeds 0.35 m; 2 when the maps are not there.

    python tests/proofs/five_maps.py [--maps DIR] [--only NAME] [--controller mppi|dwb|rpp] [--length 10 --length 20]
"""

import tempfile
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import Instantiation, instantiate
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.pose import pose_of
from vastflow.sim.model.recording import Recording, si
from vastflow.sim.run import run

MAPS = Path(__file__).parents[3] / "shared" / "maps"
PATHS = 10
RUNS = 3
LENGTHS_M = (10.0, 20.0)
LEAST_SHARE = 0.95
GREATEST_MEDIAN_M = 0.35


def parser_of(about: str | None) -> ArgumentParser:
    """Options of all proofs on the paper's maps."""
    parser = ArgumentParser(description=about, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--maps", type=Path, default=MAPS, metavar="DIR", help="folder of <name>/<name>.yaml")
    parser.add_argument("--only", action="append", metavar="NAME", help="this map alone; may be repeated")
    return parser


def map_files(maps: Path, only: Iterable[str] | None) -> list[Path]:
    """Return the requested maps, and print where there are none."""
    files = sorted(file for file in maps.glob("*/*.yaml") if not only or file.stem in only)
    if not files:
        print(f"no maps in {maps}")
    return files


def instantiated(
    map_file: Path,
    controller: str,
    path: Mapping[str, float],
    parameters: Mapping[str, float] | None = None,
    more: Iterable[Mapping[str, Any]] = (),
) -> Instantiation:
    """The configurations of random paths on a map, by way of a campaign file.

    Args:
        path: Parameters of `PathVariationRandom`, beside those that are the same for all.
        parameters: Of the family.
        more: Producers after the paths.
    """
    given = {"map_file": str(map_file.resolve()), "robot_radius": 0.22, "controller": controller, **(parameters or {})}
    paths = {"min_distance": 1.0, "robot_diameter": 0.5, "seed": 42, "goal_poses": "@goal_pose", **path}
    family = {
        "name": map_file.stem,
        "parameters": [{key: value} for key, value in given.items()],
        "variations": [{"PathVariationRandom": paths}, *more],
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "maps.vast"
        file.write_text(yaml.safe_dump({"version": 1, "configuration": [family], "execution": {"runs": 1}}))
        return instantiate(load_campaign(file))


@dataclass(frozen=True)
class Mission:
    """One run, measured; its text says where and how it ended, with what went before."""

    configuration: Configuration
    recording: Recording
    final_m: float
    localization_m: np.ndarray

    def __str__(self) -> str:
        done, columns = self.recording.run, self.recording.columns
        x_m, y_m = (si(columns[name])[-1] for name in ("x_mm", "y_mm"))
        told = [f"{event.t_s:.0f} s {event.kind} {event.what}" for event in done.events][-8:]
        return (
            f"{self.configuration.name} run {done.run_index}: {done.outcome} ({done.error_code}): {done.reason}; "
            f"at ({x_m:.2f}, {y_m:.2f}), {self.final_m:.2f} m from the goal after {done.simulated_s:.0f} s; {', '.join(told)}"
        )


def missions_of(configurations: Iterable[Configuration]) -> Iterator[Mission]:
    """Every run of every configuration, in this process."""
    for configuration in configurations:
        goal = pose_of(configuration.scenario.task["goal_pose"])
        for run_index in range(RUNS):
            recording = run(configuration.scenario, run_index)
            names = ("x_mm", "y_mm", "estimated_x_mm", "estimated_y_mm")
            x_m, y_m, believed_x_m, believed_y_m = (si(recording.columns[name]) for name in names)
            off_m = np.hypot(x_m - believed_x_m, y_m - believed_y_m)
            yield Mission(configuration, recording, float(np.hypot(x_m[-1] - goal.x_m, y_m[-1] - goal.y_m)), off_m)


def line_of(name: str, missions: list[Mission], cpu_s: float) -> dict[str, Any]:
    """The map's line of the table."""
    runs = [mission.recording.run for mission in missions]
    final_m = [mission.final_m for mission in missions]
    localization_m = np.concatenate([mission.localization_m for mission in missions])
    codes = Counter(done.error_code for done in runs if done.outcome != "succeeded")
    return {
        "map": name,
        "runs": len(runs),
        "reached": len(runs) - codes.total(),
        "final median (m)": np.median(final_m),
        "max (m)": max(final_m),
        "localization mean (m)": localization_m.mean(),
        "localization max (m)": localization_m.max(),
        "time (s)": np.median([done.simulated_s for done in runs]),
        "recoveries": sum(done.recoveries for done in runs),
        "x real time": round(sum(done.simulated_s for done in runs) / cpu_s),
        "failures": ", ".join(f"{code} × {count}" for code, count in sorted(codes.items())) or "none",
    }


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--controller", choices=("mppi", "dwb", "rpp"), default="mppi")
    parser.add_argument("--length", action="append", type=float, metavar="M", help="of the paths; may be repeated")
    options = parser.parse_args()
    files = map_files(options.maps, options.only)
    good = True
    for length_m in options.length or LENGTHS_M:
        lines, told = [], []
        for file in files:
            path = {"path_length": length_m, "path_length_tolerance": 0.5, "num_paths": PATHS}
            instantiation = instantiated(file, options.controller, path)
            told += [f"{file.stem}: {rejection.reason}" for rejection in instantiation.rejections]
            if not instantiation.configurations:
                continue
            # Kernels are compiled and the map's tables made before the clock starts.
            run(instantiation.configurations[0].scenario, 0)
            began = time.process_time()
            missions = list(missions_of(instantiation.configurations))
            lines.append(line := line_of(file.stem, missions, time.process_time() - began))
            good &= line["reached"] >= LEAST_SHARE * line["runs"] and line["final median (m)"] <= GREATEST_MEDIAN_M
            told += [str(mission) for mission in missions if mission.recording.run.outcome != "succeeded"]
        print(f"{options.controller}, paths of {length_m:g} m")
        print(pd.DataFrame(lines).to_string(index=False, float_format="{:.3f}".format))
        print("\n".join(["", *(told or ["every mission reached its goal"]), ""]), flush=True)
    return (0 if good else 1) if files else 2


if __name__ == "__main__":
    raise SystemExit(main())
