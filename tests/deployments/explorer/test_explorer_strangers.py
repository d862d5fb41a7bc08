"""Pages of hostile campaign directories: they are drawn, nothing of them is executed, and an execution is permitted first."""

import pytest
from hostile import RADIUS_M, executed, stranger
from unpacked import unpacked

from vastflow.flows.results.trust import foreign_code

OWN = {"origin": "http://127.0.0.1:8000"}
RUN = {"configuration": "room", "name": "room", "run": "0"}


@pytest.fixture
def foreign(results, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return stranger(results, tmp_path / "canary")


def test_pages_of_foreign_campaign_execute_no_plug_in(client, results, foreign, id_of, tmp_path):
    other = stranger(results, tmp_path / "canary", day=21)
    asked = {"c": id_of(foreign), "a": id_of(foreign), "b": id_of(other), **RUN}
    pages = ("/", "/campaign", "/run", "/configuration", "/compare", "/live", "/live-run")
    views = ("frames", "layers", "summary", "facets", "rows", "points", "table", "configuration")
    replies = {path: client.get(path, params=asked).status_code for path in (*pages, *(f"/api/{v}" for v in views))}
    assert executed(tmp_path / "canary") == []
    shown = ("/", "/campaign", "/run", "/configuration", "/compare", "/api/frames")
    assert {path: replies[path] for path in shown} == dict.fromkeys(shown, 200)
    assert replies["/api/layers"] == 405


def test_page_of_a_foreign_run_shows_the_robot(client, foreign, id_of):
    header, _ = unpacked(client.get("/api/frames", params={"c": id_of(foreign), **RUN}).content)
    assert header["robot"]["radius_m"] == RADIUS_M


@pytest.mark.slow
@pytest.mark.parametrize("view", ["layers", "mcap"])
def test_execution_names_the_code_and_waits_for_permission(client, foreign, id_of, tmp_path, view):
    asked = {"c": id_of(foreign), **RUN}
    for permit in ("", "0" * 64):
        reply = client.post(f"/api/{view}", params={**asked, "permit": permit}, headers=OWN)
        assert (reply.status_code, reply.json()["asks"]["named"]) == (409, ["inputs/my_pursuit.py"])
        assert "would execute code that you neither made nor permitted" in reply.json()["error"]
    assert executed(tmp_path / "canary") == []
    digest = reply.json()["asks"]["digest"]
    assert digest == foreign_code(foreign).digest
    assert client.post(f"/api/{view}", params={**asked, "permit": digest}).status_code == 403  # from another page
    reply = client.post(f"/api/{view}", params={**asked, "permit": digest}, headers=OWN)
    assert (reply.status_code, len(executed(tmp_path / "canary"))) == (200, 1), reply.text[:500]
    assert client.post(f"/api/{view}", params=asked, headers=OWN).status_code == 200
    if view == "mcap":
        assert reply.content.startswith(b"\x89MCAP0\r\n")


@pytest.mark.slow
def test_bag_is_of_a_configuration_of_the_campaign_alone(client, foreign, id_of, tmp_path):
    for name in ("../room", "room/../room", "/etc/passwd", "room\0", ""):
        asked = {"c": id_of(foreign), "configuration": name, "run": "0"}
        reply = client.post("/api/mcap", params=asked, headers=OWN)
        assert reply.status_code in (400, 409) and "asks" not in reply.json(), name
    assert executed(tmp_path / "canary") == []
