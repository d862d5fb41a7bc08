"""Campaign directories, and a client of an explorer of them."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from explored import TOKEN, explorer_of, write_explored
from starlette.testclient import TestClient
from synthetic import walled_room, write_map

from vastflow.deployments.explorer.directories import Directories


@pytest.fixture(scope="session")
def a_room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of a room of 6 m × 4 m."""
    return write_map(tmp_path_factory.mktemp("room"), walled_room(6.0, 4.0))


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """The folder that the explorer is given."""
    (tmp_path / "results").mkdir()
    return tmp_path / "results"


@pytest.fixture
def add_campaign(results: Path, a_room: Path) -> Callable[..., Path]:
    """Writes the campaign of a day, see `write_explored`."""
    return partial(write_explored, results, a_room)


@pytest.fixture
def stranger(results: Path) -> TestClient:
    """A client without the token; it follows no redirect."""
    return explorer_of(results)


@pytest.fixture
def client(stranger: TestClient) -> TestClient:
    """A client with the cookie; it follows no redirect."""
    assert stranger.get("/", params={"token": TOKEN}).status_code == 303
    return stranger


@pytest.fixture
def id_of(results: Path) -> Callable[[Path], str]:
    """The id of a campaign directory in addresses."""
    return lambda path: {each.path: each.id for each in Directories([results]).all()}[path]
