"""Processes of a campaign that are killed: the short form of tests/proofs/killed.py, and what Prefect shows of them afterwards."""

import random
import shutil
import signal
import socket
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from prefect.client.orchestration import get_client
from prefect.settings import temporary_settings

from vastflow.tasks.server import ApiServer, PrefectUnavailable

pytestmark = pytest.mark.timeout(280)

PROOFS = Path(__file__).parents[1] / "proofs"
START_S = 90
SEED = 3


@pytest.fixture(scope="module")
def killed():
    """The proof as a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PROOFS)
        import killed

        yield killed
        for name in ("killed", "killed_life"):
            del sys.modules[name]


@pytest.fixture(scope="module")
def lab(killed, tmp_path_factory):
    return killed.Lab.made(tmp_path_factory.mktemp("killed"), copied=False)


@pytest.fixture(scope="module")
def alone(killed, lab):
    """What the campaign comes to when nothing happens to it, and when each of its processes was there."""
    return killed.undisturbed(lab, twice=False)


@pytest.mark.parametrize("victim", ["flow", "worker", "server"])
def test_a_process_that_is_killed_at_a_random_time_costs_nothing_but_what_was_in_flight(killed, lab, alone, victim):
    whole, there = alone
    (point,) = killed.points(SEED, 1, [victim], there)
    killed.killed(lab, point, random.Random(f"{SEED} {victim}"), whole, api=None)
    assert point.violations == []


@pytest.fixture(scope="module")
def api(lab, alone, tmp_path_factory):
    """A client of an API that outlives campaigns."""
    folder = tmp_path_factory.mktemp("api")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PREFECT_HOME", str(lab.home))
        server = ApiServer(folder / "server.log")
        try:
            url = server.url(START_S)
        except PrefectUnavailable as error:
            server.stop(0)
            pytest.skip(str(error))
        try:
            with temporary_settings({"api.url": url}), get_client(sync_client=True) as client:
                yield client
        finally:
            server.stop()


def states(api):
    return sorted(run.state.type.value for run in api.read_flow_runs() if run.name.startswith("killed"))


def test_a_flow_run_whose_process_was_killed_has_crashed_once_the_campaign_is_run_again(killed, lab, alone, api):
    place = killed.Place(lab, "configured", api=str(api.api_url))
    before = states(api)
    life = place.begin()
    while not list(place.ledger.glob("*.json")) and life.process.poll() is None:
        time.sleep(0.02)
    life.process.kill()
    assert life.end() == -signal.SIGKILL
    assert sorted([*before, "RUNNING"]) == states(api)
    assert place.begin().end() == 0
    assert sorted([*before, "COMPLETED", "CRASHED"]) == states(api)
    (directory,) = place.directories()
    assert killed.differing(alone[0].files, killed.digests(directory)) == ""


def test_with_nothing_missing_a_configured_server_is_asked_nothing(killed, lab, alone):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        place = killed.Place(lab, "asked", api=f"http://127.0.0.1:{listener.getsockname()[1]}/api")
        shutil.copytree(lab.folder / "first" / "store", place.store)
        life = place.begin()
        assert life.end() == 0, life.words()
        assert (life.summary()["executed"], life.summary()["reused"]) == (0, killed.CONFIGURATIONS * killed.RUNS)
        listener.setblocking(False)
        with pytest.raises(BlockingIOError):  # nobody is waiting to be let in
            listener.accept()


def test_a_server_that_is_not_there_is_told_in_a_sentence_with_how_to_go_on(killed, lab, alone):
    place = killed.Place(lab, "nowhere", api="http://127.0.0.1:9/api")
    life = place.begin()
    assert life.end(60) == 3
    assert "Prefect's API at http://127.0.0.1:9/api failed" in life.words()
    assert "start it (`prefect server start`), or unset PREFECT_API_URL; `vastflow run" in life.words()
    assert "Traceback" not in life.words()
    assert place.directories() == []


OTHER = """\
- name: more
  variations:
  - ParameterVariationList: {name: first, values: [31, 32]}
  - ParameterVariationList: {name: second, values: [41]}
execution:"""


def test_two_campaigns_at_once_on_one_store_come_to_what_each_comes_to_alone(killed, lab, alone):
    text = lab.campaign.read_text()
    other = lab.folder / "other.vast"
    other.write_text(text.replace("execution:", OTHER).replace("name: killed", "name: other"))
    together, apart = killed.Place(lab, "together"), killed.Place(lab, "apart")
    lives = [together.begin(), together.begin(campaign=other)]
    assert [life.end() for life in lives] == [0, 0], [life.words() for life in lives]
    assert apart.begin(campaign=other).end() == 0
    mine, others = together.directories()
    assert killed.differing(alone[0].files, killed.digests(mine)) == ""
    assert killed.differing(killed.digests(apart.directories()[0]), killed.digests(others)) == ""
    assert len(pq.read_table(others / "runs.parquet")) == 32 * killed.RUNS
    store = killed.open_local_store(together.store)
    assert [store.fault(holding.key) for holding in store.holdings() if store.fault(holding.key)] == []
