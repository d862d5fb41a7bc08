"""Find starts from which the robot cannot move."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from paper_published import LOCAL_PADDING_M, LOCAL_RADIUS_M
from scipy import ndimage

from vastflow.oracles.judgement.verdict import Judgement
from vastflow.oracles.statistics.intervals import Counts, counts_of
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap

COLLISION_M: Final = inscribed_radius_m(padded_outline(LOCAL_RADIUS_M, LOCAL_PADDING_M))
"""Distance of the robot's center from a wall up to which the wall reaches into its padded footprint (m)."""


@dataclass(frozen=True, slots=True)
class Begun:
    """Configurations that start alike.

    Attributes:
        counts: What all oracles together say of their runs.
        stood_still: Runs whose robot was sent and never moved.
    """

    configurations: int
    counts: Counts
    stood_still: int


@dataclass(frozen=True, slots=True)
class Starts:
    """The configurations of a campaign by where they start.

    Attributes:
        near: Those that start with a wall in their padded footprint.
        free: The others.
        moved: What all oracles together say of the runs that did not stand still, wherever they start.
        causes: Why runs stood still, of `vastflow.sim.loop.standstill.CAUSES`, to how many did.
    """

    near: Begun
    free: Begun
    moved: Counts
    causes: Mapping[str, int]


def starts_of(
    environments: Path,
    configurations: Iterable[Mapping[str, Any]],
    runs: Iterable[Mapping[str, Any]],
    judgements: Mapping[tuple[str, int], Judgement],
) -> Starts:
    """Sort configurations by the room they have at the start.

    Args:
        environments: Folder of the campaign directory's maps.
        configurations: `name`, `environment` and the pose `start`, a row each.
        runs: `configuration`, `run_index` and `stood_still`, the cause or None, a row each.
        judgements: Configuration and run index to what all oracles together say.

    Raises:
        ValueError, OSError: a map is damaged.
    """

    @cache
    def ground(environment: str) -> tuple[OccupancyMap, NDArray[np.float64]]:
        occupancy = load_map(environments / environment / "map.yaml")
        cells = ndimage.distance_transform_edt(~occupancy.occupied)
        return occupancy, np.maximum(cells - 0.5, 0.0) * occupancy.resolution_m

    def is_near(environment: str, position: Mapping[str, float]) -> bool:
        """Whether a wall's cell is that near, or the place off the map."""
        occupancy, distance_m = ground(environment)
        cell = occupancy.cell_of(position["x"], position["y"])
        return not occupancy.contains(*cell) or round(float(distance_m[cell]), 9) <= COLLISION_M

    near = {row["name"]: is_near(row["environment"], row["start"]["position"]) for row in configurations}
    stood_still = {
        (row["configuration"], row["run_index"]): row["stood_still"] for row in runs if row["stood_still"] is not None
    }

    def begun(beside_a_wall: bool) -> Begun:
        names = {name for name, beside in near.items() if beside is beside_a_wall}
        said = counts_of(judgement for (name, _), judgement in judgements.items() if name in names)
        return Begun(len(names), said, sum(name in names for name, _ in stood_still))

    moved = counts_of(said for key, said in judgements.items() if key not in stood_still)
    return Starts(begun(True), begun(False), moved, Counter(stood_still.values()))
