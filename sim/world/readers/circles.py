"""Worlds of circles: a CSV file with a position and a radius in each line."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from vastflow.sim.model.files import read_text
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Disc
from vastflow.sim.world.bodies import Body
from vastflow.sim.world.readers.reader import FARTHEST_M, WorldError


class Circles:
    """Reader of lines x, y, radius (m), with or without a line of names before them."""

    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    @staticmethod
    def files(path: Path) -> list[Path]:
        return [path]

    @staticmethod
    def read(path: Path) -> Iterator[Body]:
        text = read_text(path, "a CSV file of circles")
        for line, row in enumerate(csv.reader(text.splitlines()), 1):
            if not row or (line == 1 and [name.strip().lower() for name in row] == ["x", "y", "radius"]):
                continue
            try:
                x_m, y_m, radius_m = map(float, row)
            except ValueError:
                raise WorldError(
                    f"{path}:{line}: expected three numbers x, y, radius (m), got {','.join(row)!r}"
                ) from None
            if not (max(abs(x_m), abs(y_m)) <= FARTHEST_M and 0.0 < radius_m <= FARTHEST_M):
                right = f"a circle within {FARTHEST_M:g} m of the origin and of a radius above 0"
                raise WorldError(f"{path}:{line}: expected {right}, got {','.join(row)!r}")
            yield Body(f"circle {line}", Disc(radius_m), Pose(x_m, y_m, 0.0))
