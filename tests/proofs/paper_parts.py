"""The configurations of a campaign in parts, by what it varies."""

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from paper_published import Kind

from vastflow.oracles.statistics.intervals import Counts, pooled

DENSITIES_PER_M: Final = (0.2, 0.6)

Row = Mapping[str, Any]
Place = tuple[str, float]
"""What varies, and its level: the order of the parts."""


@dataclass(frozen=True, slots=True)
class Part:
    """Some of the configurations, and what is said of their runs."""

    name: str
    configurations: int
    counts: Counts


def parts_of(kind: Kind, configurations: Sequence[Row], counts: Mapping[str, Counts]) -> tuple[Part, ...]:
    """Every level of everything that varies, in order.

    Args:
        configurations: Rows with `name`, and `factors` and `provenance` as JSON.
        counts: Configuration to what all oracles together say of its runs.
    """
    found: dict[tuple[Place, str], list[Counts]] = defaultdict(list)
    for row in configurations:
        for place, name in _levels(kind, json.loads(row["factors"]), json.loads(row["provenance"])):
            found[place, name].append(counts.get(row["name"], Counts()))
    return tuple(Part(name, len(found[place, name]), pooled(found[place, name])) for place, name in sorted(found))


def _levels(kind: Kind, factors: Row, provenance: Row) -> Iterator[tuple[Place, str]]:
    if kind == "robustness":
        loops, lost = factors["number_of_loops"], factors["laserscan_random_drop_percentage"]
        noise_m = factors["laserscan_gaussian_noise_std_deviation"]
        yield ("loops", loops), f"loops {loops}"
        yield ("lost", lost), f"lost beams {100 * lost:.0f} %"
        yield ("noise", noise_m), f"noise {noise_m:.2f} m"
        return
    radius_m = factors["global_costmap.robot_radius"]
    yield ("global", radius_m), f"global radius {radius_m:.3f} m"
    if kind == "safety":
        yield _obstacles(factors, provenance)


def _obstacles(factors: Row, provenance: Row) -> tuple[Place, str]:
    obstacles = factors.get("static_objects", [])
    if "spawn_trigger_threshold" in factors:
        ahead_m = factors["spawn_trigger_threshold"]
        return ("obstacle appears", ahead_m), f"obstacle appears at {ahead_m:g} m"
    if not obstacles:
        return ("obstacles", 0.0), "no obstacles"
    found_per_m = len(obstacles) / provenance["_path_length"]
    density_per_m = min(DENSITIES_PER_M, key=lambda asked_per_m: abs(asked_per_m - found_per_m))
    return ("obstacles", density_per_m), f"obstacles, {density_per_m:g} for each meter"
