"""Campaign directories, and a client of an explorer of them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from starlette.testclient import TestClient
from synthetic import SyntheticCampaign, a_recording, walled_room, write_map

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.server import application
from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.results.tables import read_tables

TOKEN = "a-token-of-the-tests"
PLACE = "http://127.0.0.1:8000"
CAMPAIGN = """\
version: 1
metadata: {name: office}
execution:
  runs: 4
"""
WALK = [(1.0 + 0.1 * i, 2.0) for i in range(41)]


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
    """Writes the campaign of a day.

    Its configurations are `KEY-1` … of families, each with as many of its four runs lost as listed. Families' names have different lengths.
    """

    def added(day: int, families: dict[str, list[int]], *, name: str = "office", text: str = CAMPAIGN) -> Path:
        campaign = SyntheticCampaign(results / f"{name}-2026-11-{day:02}-060000")
        passed = failed = 0
        for family, losses in families.items():
            for k, lost in enumerate(losses, start=1):
                runs = [recorded(i, i < lost) for i in range(4)]
                passed, failed = passed + 4 - lost, failed + lost
                goal = {"x": 5.0 - 0.1 * k, "y": 1.0 + 0.1 * len(family)}  # no two alike
                task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": goal}
                campaign.add(f"{family}-{k}", family, a_room, task, recordings=runs, factors={"noise": 0.1 * k})
        for row in campaign.configurations:
            row["checked_digest"] = row["scenario_digest"]
        counts = {"configurations": len(campaign.configurations), "runs": passed + failed, "rejected": 0}
        counts |= {"passed": passed, "failed": failed, "not_judged": 0}
        stages = ("instantiate", "execute", "observe", "judge")
        source = {stage: {"files": {}, "libraries": {}} for stage in stages}
        campaign.metadata |= {"source": dict.fromkeys(source, "1"), "numeric_class": "x", "seed": 0, "code": source}
        campaign.metadata |= {"oracles": [], "name": name, "created": f"2026-11-{day:02}T06:00:00", "counts": counts}
        directory = campaign.write(text)
        write_wide(directory, wide_table(read_tables(directory)))
        return directory

    return added


def recorded(run_index: int, lost: bool):
    """A run through the room with a seed of its own, which stops half way if it is lost."""
    walk = WALK[:20] if lost else WALK
    outcome, reason = ("aborted", "stuck") if lost else ("succeeded", "")
    found = a_recording(walk, run_index=run_index, outcome=outcome, reason=reason)
    return replace(found, run=replace(found.run, seed=f"1-2-{run_index}"))


@pytest.fixture
def stranger(results: Path) -> TestClient:
    """A client without the token; it follows no redirect."""
    app = application(Directories([results]), TOKEN)
    return TestClient(app, PLACE, raise_server_exceptions=False, follow_redirects=False)


@pytest.fixture
def client(stranger: TestClient) -> TestClient:
    """A client with the cookie; it follows no redirect."""
    assert stranger.get("/", params={"token": TOKEN}).status_code == 303
    return stranger


@pytest.fixture
def id_of(results: Path) -> Callable[[Path], str]:
    """The id of a campaign directory in addresses."""
    return lambda path: {each.path: each.id for each in Directories([results]).all()}[path]
