"""A whole campaign over a store on S3, with a real Prefect, worker processes, and a server that dies."""

import pytest

from vastflow.flows import api, run_campaign
from vastflow.flows.computing import computation
from vastflow.tasks.object_store import ObjectStore
from vastflow.tasks.source import installed_tree
from vastflow.tasks.store import StoreError

pytestmark = pytest.mark.timeout(280)

CAMPAIGN = """
version: 1
metadata: {name: remote}
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.5, yaw: 0.0}
      - goal_pose: {x: 1.6, y: 1.5, yaw: 0.0}
    variations:
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.01]
execution: {runs: 2, timeout: 30}
"""
CONFIGURATIONS = 2


@pytest.fixture
def file(tmp_path, monkeypatch):
    """The campaign's file; its map and Prefect's home are beside it."""
    side = 60
    cells = bytes(0 if x in (0, side - 1) or y in (0, side - 1) else 254 for y in range(side) for x in range(side))
    (tmp_path / "room.pgm").write_bytes(b"P5 %d %d 255\n" % (side, side) + cells)
    (tmp_path / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [0, 0, 0]}")
    (tmp_path / "remote.vast").write_text(CAMPAIGN)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "prefect"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    tree = installed_tree()
    monkeypatch.setattr(api, "installed_tree", lambda: tree)
    return tmp_path / "remote.vast"


class KillsAfter:
    """Kills a server once so many runs have been executed."""

    def __init__(self, server, runs):
        self.server, self.runs = server, runs

    def update(self, progress):
        if self.server is not None and progress.executed >= self.runs:
            self.server.kill()
            self.server = None


def test_a_campaign_over_s3_goes_on_after_its_server_was_gone(file, tmp_path, start_s3, s3_variables, monkeypatch):
    server = start_s3()
    s3_variables(server)
    monkeypatch.setattr(ObjectStore, "local", tmp_path / "local")
    monkeypatch.delenv("XDG_CACHE_HOME")  # where the compiled kernels are that other tests have used

    def run(runs, **options):
        return run_campaign(
            file, results=tmp_path / "results", store="s3://bucket/store", runs=runs, workers=2, **options
        )

    with pytest.raises(StoreError, match=rf"store: can't use 's3://bucket/store' .*{server.url}"):
        run(200, observer=KillsAfter(server, 10))
    assert list((tmp_path / "results").glob("*")) == []
    server.start()

    found = run(200)
    assert found.faults == ()
    assert found.summary.reused >= 10
    assert found.summary.executed + found.summary.reused == 200 * CONFIGURATIONS

    def refuse(*_):
        raise AssertionError("Prefect was started")

    monkeypatch.setattr(computation, "ApiServer", refuse)
    again = run(200)
    assert (again.summary.executed, again.summary.reused) == (0, 200 * CONFIGURATIONS)
    recordings = [(result.directory / "recordings" / "room-1.parquet").read_bytes() for result in (found, again)]
    assert recordings[0] == recordings[1]
