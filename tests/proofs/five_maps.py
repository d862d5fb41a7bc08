"""On each of the paper's five maps: random paths, several runs each, without noise or obstacles.

Prints a table for each length with a line a map, and every failure with its reason and where it happened. A length that a map
has no path of is said and left out. Exit code 1 when a map falls below 95 % of missions or the median true final
distance to the goal exceeds 0.35 m; 2 when the maps are not there.

    python tests/proofs/five_maps.py [--maps DIR] [--only NAME] [--controller mppi|dwb|rpp] [--length 10 --length 20]
"""

import argparse
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

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

CAMPAIGN = """\
version: 1
configuration:
- name: {name}
  parameters:
  - map_file: {map_file}
  - robot_radius: 0.22
  - controller: {controller}
  variations:
  - PathVariationRandom:
      path_length: {length_m}
      path_length_tolerance: 0.5
      num_paths: {paths}
      min_distance: 1.0
      robot_diameter: 0.5
      seed: 42
      goal_poses: "@goal_pose"
execution:
  runs: {runs}
"""

HEADER = (
    "map",
    "runs",
    "reached",
    "share",
    "final median",
    "max",
    "localization mean",
    "max",
    "time",
    "rec.",
    "speed",
    "failures",
)
UNITS = ("", "", "", "%", "m", "m", "m", "m", "s", "", "x real time", "code × missions")


@dataclass(frozen=True)
class Mission:
    """One run, measured."""

    configuration: Configuration
    recording: Recording
    final_m: float
    localization_m: np.ndarray

    @property
    def reached(self) -> bool:
        return self.recording.run.outcome == "succeeded"


def instantiated(map_file: Path, length_m: float, controller: str) -> Instantiation:
    """The map's configurations of one path length, by way of a campaign file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "five_maps.vast"
        file.write_text(
            CAMPAIGN.format(
                name=map_file.stem,
                map_file=map_file.resolve(),
                controller=controller,
                length_m=length_m,
                paths=PATHS,
                runs=RUNS,
            )
        )
        return instantiate(load_campaign(file))


def missions_of(configurations: Iterable[Configuration]) -> Iterator[Mission]:
    """Every run of every configuration, in this process."""
    for configuration in configurations:
        goal = pose_of(configuration.scenario.task["goal_pose"])
        for run_index in range(RUNS):
            recording = run(configuration.scenario, run_index)
            x_m, y_m = si(recording.columns["x_mm"]), si(recording.columns["y_mm"])
            off_m = np.hypot(
                x_m - si(recording.columns["estimated_x_mm"]), y_m - si(recording.columns["estimated_y_mm"])
            )
            yield Mission(configuration, recording, float(np.hypot(x_m[-1] - goal.x_m, y_m[-1] - goal.y_m)), off_m)


def summary(name: str, missions: list[Mission], cpu_s: float) -> tuple[tuple[str, ...], bool]:
    """The map's line of the table, and whether it is good enough."""
    reached = sum(mission.reached for mission in missions)
    final_m = [mission.final_m for mission in missions]
    localization_m = np.concatenate([mission.localization_m for mission in missions])
    simulated_s = [mission.recording.run.simulated_s for mission in missions]
    codes = Counter(mission.recording.run.error_code for mission in missions if not mission.reached)
    line = (
        name,
        f"{len(missions)}",
        f"{reached}",
        f"{100 * reached / len(missions):.1f}",
        f"{statistics.median(final_m):.3f}",
        f"{max(final_m):.3f}",
        f"{localization_m.mean():.3f}",
        f"{localization_m.max():.3f}",
        f"{statistics.median(simulated_s):.1f}",
        f"{sum(mission.recording.run.recoveries for mission in missions)}",
        f"{sum(simulated_s) / cpu_s:.0f}",
        ", ".join(f"{code} × {count}" for code, count in sorted(codes.items())) or "none",
    )
    return line, reached >= LEAST_SHARE * len(missions) and statistics.median(final_m) <= GREATEST_MEDIAN_M


def table(lines: list[tuple[str, ...]]) -> str:
    rows = [HEADER, UNITS, *lines]
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADER))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def failure(mission: Mission) -> str:
    """One mission that did not reach its goal, with what went before."""
    run_ = mission.recording.run
    x_m, y_m = si(mission.recording.columns["x_mm"])[-1], si(mission.recording.columns["y_mm"])[-1]
    told = [f"{event.t_s:.0f} s {event.kind} {event.what}" for event in run_.events][-8:]
    return (
        f"{mission.configuration.name} run {run_.run_index}: {run_.outcome} ({run_.error_code}): {run_.reason}; "
        f"at ({x_m:.2f}, {y_m:.2f}), {mission.final_m:.2f} m from the goal after {run_.simulated_s:.0f} s; {', '.join(told)}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", type=Path, default=MAPS, metavar="DIR", help="folder of <name>/<name>.yaml")
    parser.add_argument("--only", action="append", metavar="NAME", help="this map alone; may be repeated")
    parser.add_argument("--controller", choices=("mppi", "dwb", "rpp"), default="mppi")
    parser.add_argument("--length", action="append", type=float, metavar="M", help="of the paths; may be repeated")
    options = parser.parse_args()
    files = sorted(file for file in options.maps.glob("*/*.yaml") if not options.only or file.stem in options.only)
    if not files:
        print(f"no maps in {options.maps}")
        return 2
    good = True
    for length_m in options.length or LENGTHS_M:
        lines: list[tuple[str, ...]] = []
        told: list[str] = []
        for file in files:
            instantiation = instantiated(file, length_m, options.controller)
            told += [f"{file.stem}: {rejection.reason}" for rejection in instantiation.rejections]
            if not instantiation.configurations:
                continue
            # Kernels are compiled and the map's tables made before the clock starts.
            run(instantiation.configurations[0].scenario, 0)
            began = time.process_time()
            missions = list(missions_of(instantiation.configurations))
            line, good_enough = summary(file.stem, missions, time.process_time() - began)
            lines.append(line)
            good = good and good_enough
            told += [failure(mission) for mission in missions if not mission.reached]
        print(f"{options.controller}, paths of {length_m:g} m")
        print(table(lines))
        print("\n".join(["", *(told or ["every mission reached its goal"]), ""]), flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
