"""Independent units: what does not repeat among the configurations of a campaign."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.world.environment import GROUND_KEYS

_text: Final = json.JSONEncoder(sort_keys=True, ensure_ascii=False).encode


@dataclass(frozen=True, eq=False)
class Units:
    """The units of configurations, the clusters of every statement on others like them.

    Attributes:
        codes: (m,) unit of each configuration.
        noun: `path`, `map`, or `situation`.
        others: The other units that results over these ones generalize to: `paths on these 3 maps`, `maps with these paths`.
    """

    codes: NDArray[np.int64] = field(repr=False)
    noun: str
    others: str


def units_of(scenarios: Iterable[Mapping[str, Any]]) -> Units:
    """Return the units of configurations: their paths, or their maps where there are more maps than paths.

    A path is a start and its goals, whatever obstacles and system, and on several maps as well: configurations that share it share its
    difficulty. Results over paths hold for other paths on the same maps, and results over maps for other maps with the same paths.
    Configurations without map and task, as of programs under test, share nothing.

    Args:
        scenarios: The dimensions `environment`, `task` and `system` of each configuration, as in the column `scenario`.
    """
    rows = [
        (next((found[key] for key in GROUND_KEYS if key in found), None), row.get("task", {}))
        for row in scenarios
        for found in [row.get("environment", {})]
    ]
    maps = numbers_of([place for place, _ in rows])
    # The same poses driven otherwise, such as in more rounds, are one path.
    paths = numbers_of([{k: v for k, v in task.items() if isinstance(v, dict | list)} or task for _, task in rows])
    alone = [place is None and not task for place, task in rows]
    count, of_maps = len({*paths.tolist()}), len({*maps[[place is not None for place, _ in rows]].tolist()})
    if of_maps > count:
        return Units(maps, "map", f"maps with {'these paths' if count > 1 else 'this path'}")
    codes = np.where(alone, len(rows) + np.arange(len(rows)), paths).astype(np.int64)
    if not of_maps:
        return Units(codes, "situation", "situations")
    return Units(codes, "path", f"paths on {f'these {of_maps} maps' if of_maps > 1 else 'this map'}")


def numbers_of(values: Iterable[Any]) -> NDArray[np.int64]:
    """Numbers (m,) that are equal for equal JSON values, in the order of their first."""
    keys = [_text(value) for value in values]
    numbers = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    return np.array([numbers[key] for key in keys], dtype=np.int64)
