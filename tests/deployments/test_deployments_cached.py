"""A call that computes nothing, on the pages of an API that the user has configured."""

import pytest

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.summary import Results, Summary
from vastflow.flows.run.pages import show_cached
from vastflow.tasks.prefect.server import may_be_configured

pytestmark = pytest.mark.timeout(900)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("lab")


def test_call_that_computes_nothing_is_one_flow_run_in_state_cached(api, place):
    summary = Summary(2, 0, 0, 4, 0, 4, 3, 1, 0, 0.0, 1.0, 1.0, str(place), {})
    show_cached(Results(place, summary, (), ()), "Two rooms", RunRequest(campaign="rooms.vast", runs=2))
    (found,) = api.read_flow_runs()
    assert (found.name, found.state_name, found.tags) == (
        "Two rooms, 2 configurations × 2 runs",
        "Cached",
        ["vastflow", "two-rooms"],
    )
    assert found.state.is_completed()
    assert "0 runs executed, 4 from the store; report: " in found.state.message
    assert api.read_flow(found.flow_id).name == "campaign"
    assert found.parameters["request"]["campaign"] == "rooms.vast"


def test_api_is_looked_for_in_environment_and_profiles(tmp_path, monkeypatch):
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    assert not may_be_configured()
    (tmp_path / "profiles.toml").write_text('[profiles.lab]\nPREFECT_API_URL = "http://lab:4200/api"\n')
    assert may_be_configured()
    (tmp_path / "profiles.toml").unlink()
    monkeypatch.setenv("PREFECT_API_URL", "http://lab:4200/api")
    assert may_be_configured()
