"""A campaign whose `execution` can be chosen, and its run description."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.tasks.prefect.container_keys import describe
from vastflow.tasks.prefect.containers import RunDescription

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
  image: ghcr.io/me/robot:1.0
  runs: 20
  timeout: 90.5
  runs_per_job: 4
  resources:
    cpu: [{edge: 4}, {cloud: 16}]
    memory: [{edge: 8Gi}, {cloud: 1.5G}]
    gpu: 1
  secondary_containers:
    - nav_stack
    - simulation:
      resources: {cpu: 2, memory: 512Mi}
  env:
    - FOO: 1
    - COST: "$HOME $(FOO) $$x 'q'"
  run_files: ["scripts/*.sh", "*.yml"]
  pre_command: /config/scripts/pre.sh
  post_command: /config/scripts/post.sh
  run_as_user: 1001
  kubernetes:
    jobs:
      node_labels: {disk: ssd, example.org/fast: true}
"""


@pytest.fixture
def campaign_file(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a campaign file with these lines below `execution:`; scripts and a file with a space stand beside it."""
    shutil.copytree(MAPS, tmp_path / "maps")
    for name in ("scripts/pre.sh", "scripts/post.sh", "deep/er/two words.yml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"# {name}\n")

    def written(execution: str) -> Path:
        file = tmp_path / "rooms.vast"
        file.write_text(HEAD + execution)
        return file

    return written


@pytest.fixture
def described(campaign_file) -> Callable[..., RunDescription]:
    """The description of a campaign with these lines below `execution:`, by default with every key there is."""

    def description(execution: str = FULL, context: str | None = None) -> RunDescription:
        return describe(load_campaign(campaign_file(execution)), "Two_rooms", context)

    return description


@pytest.fixture(scope="module")
def api(started_api, place):
    """A client of an API of its own, in the folder that a module's `place` is."""
    with started_api(place / "prefect", place / "server.log") as client:
        yield client
