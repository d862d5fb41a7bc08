"""Maps drawn in text, for producers that need one."""

from collections.abc import Callable

import numpy as np
import pytest
from outside import paper_map
from PIL import Image

from vastflow.sim.model.digest import FileContent
from vastflow.sim.world.world import map_content

GRAY = {".": 254, "#": 0, "?": 205}


@pytest.fixture(scope="session")
def drawn_map(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., FileContent]:
    """Write a map drawn in rows of text: `.` free, `#` wall, `?` unknown, `cells` each way a letter."""

    def write(*rows: str, cells: int = 1, resolution_m: float = 0.05) -> FileContent:
        folder = tmp_path_factory.mktemp("map")
        gray = np.array([[GRAY[letter] for letter in row] for row in rows], dtype=np.uint8)
        Image.fromarray(np.kron(gray, np.ones((cells, cells), dtype=np.uint8))).save(folder / "map.pgm")
        (folder / "map.yaml").write_text(
            f"image: map.pgm\nresolution: {resolution_m}\norigin: [-1.0, -2.0, 0.0]\n"
            "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
        )
        return map_content(folder / "map.yaml")

    return write


@pytest.fixture(scope="session")
def grid_map(drawn_map: Callable[..., FileContent]) -> Callable[..., FileContent]:
    """Write a map of 0.5 m cells with walls where an array of booleans, its first row below, is true."""
    return lambda walls: drawn_map(
        *("".join("#" if wall else "." for wall in row) for row in walls[::-1]), resolution_m=0.5
    )


@pytest.fixture
def shared_map() -> Callable[[str], FileContent]:
    """One of the five maps of the paper's dataset, which lie beside the repository where they are."""
    return lambda name: map_content(paper_map(name))
