"""Pictures of configurations: map, path, stops, and obstacles."""

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vastflow.oracles.observation.situation import situation_of
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.places.ground import MAP_KEY
from vastflow.producers.places.stops import PATH_KEY, PATH_LENGTH_KEY
from vastflow.sim.model.digest import FileContent
from vastflow.sim.world.map_file import load_map

if TYPE_CHECKING:
    from vastflow.oracles.figures.case_figure import PlanView


def plan_view_of(configuration: Configuration) -> "PlanView":
    """Return the plan view of a configuration.

    Raises:
        ValueError: it has no map, or a mission or an obstacle that can't be read.
    """
    from vastflow.oracles.figures.case_figure import PlanView
    from vastflow.oracles.figures.scene import zones_of

    map_file = configuration.scenario.environment.get(MAP_KEY)
    map_path = map_file.path if isinstance(map_file, FileContent) else None
    if map_path is None:
        raise ValueError("it has no map")
    path, length_m = (configuration.provenance.get(key) for key in (PATH_KEY, PATH_LENGTH_KEY))
    title = configuration.name + (f" · path of {length_m:.2f} m" if isinstance(length_m, int | float) else "")
    path_xy_m = np.array(path if isinstance(path, list) else [], dtype=np.float64).reshape(-1, 2)
    scenario = configuration.scenario
    return PlanView(title, load_map(map_path), situation_of(scenario), path_xy_m, zones_of([scenario]))


def draw(configurations: Iterable[Configuration], folder: Path) -> list[Path]:
    """Write the pictures of configurations; one that can't be drawn is named on standard error."""
    from vastflow.oracles.figures.case_figure import plan_view_figure
    from vastflow.oracles.figures.style import png

    written = []
    for configuration in configurations:
        try:
            view = plan_view_of(configuration)
        except ValueError as error:
            print(f"not drawn: {configuration.name}: {error}", file=sys.stderr)
            continue
        folder.mkdir(parents=True, exist_ok=True)
        picture = folder / f"{configuration.name}.png"
        picture.write_bytes(png(plan_view_figure(view)))
        written.append(picture)
    return written
