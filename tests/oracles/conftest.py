"""A small campaign directory with hand-built recordings."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from synthetic import SyntheticCampaign, a_recording, box_at, walled_room, write_map


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """The map of a room of 6 m × 4 m with walls one cell (0.05 m) thick."""
    return write_map(tmp_path / "room", walled_room(6.0, 4.0))


@pytest.fixture
def synthetic_campaign(tmp_path: Path) -> SyntheticCampaign:
    """An empty campaign directory to fill."""
    return SyntheticCampaign(tmp_path / "results")


@pytest.fixture(scope="session")
def build() -> SimpleNamespace:
    """The functions above, for tests cannot import from here: `write_map, walled_room, a_recording, box_at, campaign`."""
    return SimpleNamespace(
        write_map=write_map, walled_room=walled_room, a_recording=a_recording, box_at=box_at, campaign=SyntheticCampaign
    )
