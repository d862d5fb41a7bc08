"""A campaign whose `execution` can be chosen, and the needs of its containers."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.tasks.prefect.containers import Containers, containers_of

MAPS = Path(__file__).parents[2] / "campaigns" / "quickstart" / "maps"
HEAD = """\
version: 1
metadata: {name: Two_rooms}
configuration:
  - name: rooms
    parameters:
      - map_file: maps/office.yaml
      - start_pose: {x: 1.0, y: 5.0, yaw: 0.0}
      - goal_pose: {x: 8.0, y: 3.2, yaw: 0.0}
execution:
"""
FULL = """\
  runs: 20
  timeout: 90.5
  resources:
    cpu: [{edge: 4}, {cloud: 16}]
    memory: [{edge: 8Gi}, {cloud: 1.5G}]
    gpu: 1
  env:
    - FOO: 1
    - COST: "$HOME $(FOO) $$x 'q'"
  kubernetes:
    jobs:
      node_labels: {disk: ssd, example.org/fast: true}
"""


@pytest.fixture
def campaign_file(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a campaign file with these lines below `execution:`."""
    shutil.copytree(MAPS, tmp_path / "maps")

    def written(execution: str) -> Path:
        file = tmp_path / "rooms.vast"
        file.write_text(HEAD + execution)
        return file

    return written


@pytest.fixture
def described(campaign_file) -> Callable[..., Containers]:
    """Read the needs of a campaign with these lines below `execution:`, by default with every key there is."""

    def containers(execution: str = FULL, context: str | None = None) -> Containers:
        return containers_of(load_campaign(campaign_file(execution)), "Two_rooms", context)

    return containers


@pytest.fixture(scope="module")
def api(started_api, place):
    """A client of an API of its own, in the folder that a module's `place` is."""
    with started_api(place / "prefect", place / "server.log") as client:
        yield client
