"""A small campaign for the tests of flows: a 6 m room, one family."""

from pathlib import Path

import pytest
from room import drawn_room

from vastflow.tasks.keys.source import installed_tree

CAMPAIGN = """\
version: 1
metadata:
  name: small_room
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.0, yaw: 0.0}
      - goal_pose: {x: 3.0, y: 1.0, yaw: 0.0}
    variations:
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.02]
execution:
  runs: 2
"""


@pytest.fixture(scope="session")
def tree():
    """A source tree that ignores edits of the checkout during the tests."""
    return installed_tree()


@pytest.fixture
def no_prefect(monkeypatch):
    monkeypatch.setattr(
        "vastflow.flows.flow_runs.flow_call.FlowCall.run", lambda *_: pytest.fail("Prefect was started")
    )


@pytest.fixture
def small_room(tmp_path: Path) -> Path:
    folder = tmp_path / "campaign"
    drawn_room(folder)
    (folder / "room.vast").write_text(CAMPAIGN)
    return folder / "room.vast"
