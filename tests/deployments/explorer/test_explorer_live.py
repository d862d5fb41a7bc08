"""The live page: the state that follows from events, its stream, and the request to stop."""

import json
import os
import shutil
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from urllib.parse import parse_qsl

import pytest
from hostile import executed, unfinished_stranger
from room import SMALL_ROOM, drawn_room
from table import each_row

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.live import MOST_FAILED, MOST_RECENT, LiveCampaign
from vastflow.deployments.explorer.live_page import Follower
from vastflow.flows.results.trust import remember_running
from vastflow.oracles.results.events import _LOOKS, EVENTS, Event
from vastflow.oracles.results.unfinished import STOP, WRITER, final_of, writer

BEGAN = datetime(2026, 11, 21, 6, 0, 0, tzinfo=UTC)
NAME = "office-2026-11-21-060000"
OWN = {"origin": "http://127.0.0.1:8000"}
FAMILY = {"family": "room", "configurations": 1, "runs": 8, "passed": 3, "failed": 1, "not_judged": 0}
PROGRESS = {"phase": "running", "runs_done": 4, "runs_total": 8, "executed": 4, "passed": 3, "failed": 1}


def event(name, after_s=0.0, /, **values):
    return Event(BEGAN + timedelta(seconds=after_s), name, values)


def verdicts(judgment, *runs, reason=None, configuration="room-1"):
    of = {"configuration": configuration, "family": "room"}
    return event("verdicts", 5.0, **of, judgment=judgment, reason=reason, runs=list(runs))


def state_of(*events, now_s=10.0):
    live = LiveCampaign()
    for each in (event("began", name="office"), *events):
        live.take(each)
    return live.state(BEGAN.timestamp() + now_s)


@pytest.fixture
def running(results):
    """A function that makes the folder of a running campaign with events, which this process seems to write."""

    def begun(*events, name=NAME, alive=True):
        place = results / f".{name}.running"
        place.mkdir(exist_ok=True)
        (place / EVENTS).write_bytes(b"".join(each.line for each in (event("began", name="office <1>"), *events)))
        if alive:
            (place / WRITER).write_text(json.dumps(writer()))
        return place

    return begun


def test_state_lists_lost_runs_newest_first():
    state = state_of(verdicts("pass", 0, 1), verdicts("fail", 2, 3, reason="contact"), verdicts("not judged", 4))
    assert [(run["run"], run["judgment"], run["reason"]) for run in state["lost"]] == [
        (4, "not judged", ""),
        (3, "fail", "contact"),
        (2, "fail", "contact"),
    ]
    assert (state["lost_total"], state["recent"]) == (3, "ppffn")


def test_state_takes_the_later_judgment_of_a_run():
    state = state_of(verdicts("fail", 0, 1), verdicts("pass", 0))
    assert [run["run"] for run in state["lost"]] == [1]


def test_state_counts_unlisted_lost_runs():
    state = state_of(verdicts("fail", *range(MOST_RECENT + 5)))
    assert (len(state["lost"]), state["lost_total"], len(state["recent"])) == (
        MOST_FAILED,
        MOST_RECENT + 5,
        MOST_RECENT,
    )


def test_state_has_progress_of_families_without_rates_and_with_pace():
    first = event("progress", 2.0, families=[], **(PROGRESS | {"executed": 2, "runs_done": 2}))
    state = state_of(
        first, event("progress", 4.0, families=[FAMILY, FAMILY | {"passed": 0, "failed": 0}], **PROGRESS), now_s=4.0
    )
    room, unmeasured = state["families"]
    assert (room["passed"], unmeasured["passed"]) == (FAMILY["passed"], 0)
    assert "rate" not in room and "interval" not in room
    assert "1 runs/s" in state["words"] and "about 4 s left" in state["words"]


def test_state_ignores_events_of_later_versions():
    assert state_of(event("dreamed", of="sheep"))["end"] is None


def test_state_ends_with_reason():
    state = state_of(event("stopped", reason="wrong file"))
    assert (state["end"]["reason"], state["words"]) == ("wrong file", [])


def test_running_campaign_is_listed_first_with_its_name(client, running, add_campaign):
    add_campaign(20, {"room": [1]})
    running()
    page = client.get("/").text
    assert page.index("office &lt;1&gt;") < page.index(">office<") and "running</b>" in page and "/live?c=" in page


@each_row(
    ("last", "words"),
    [
        (event("stopped", reason="wrong file"), "wrong file"),
        (event("progress", families=[], **PROGRESS), "its process is gone"),
    ],
)
def test_stopped_campaign_is_listed_with_its_reason(client, running, last, words):
    running(last, alive=False)
    page = client.get("/").text
    assert "stopped</b>" in page and words in page


def test_id_stays_when_the_campaign_ends(results, running, add_campaign):
    place = running()
    (before,) = Directories([results]).all()
    shutil.rmtree(place)
    add_campaign(21, {"room": [1]})
    (after,) = Directories([results]).all()
    assert (before.state, after.state, before.id == after.id) == ("running", "finished", True)


def test_follower_goes_on_when_the_directory_becomes_whole(results, running, add_campaign):
    place = running(verdicts("fail", 1))
    (campaign,) = Directories([results]).all()
    follower = Follower(campaign)
    assert (follower.look()["lost_total"], follower.look()["whole"]) == (1, False)
    whole = add_campaign(21, {"room": [1]})
    content = (place / EVENTS).read_bytes() + verdicts("fail", 2).line + event("ended", faults=0).line
    (whole / EVENTS).write_bytes(content)
    shutil.rmtree(place)
    state = follower.look()
    assert (state["lost_total"], state["end"]["event"], state["whole"]) == (2, "ended", True)


def test_follower_ends_when_the_process_is_gone(results, running):
    running(verdicts("fail", 1), alive=False)
    follower = Follower(Directories([results]).all()[0])
    states = [follower.look() for _ in range(_LOOKS)]
    assert [each["end"] for each in states[:-1]] == [None] * (_LOOKS - 1)
    assert states[-1]["end"]["reason"] == "its process is gone"


def test_follower_counts_damaged_lines(results, running):
    place = running(event("verdicts"), verdicts("fail", 1))
    with open(place / EVENTS, "ab") as file:
        file.write(b"{\n[]\n\xff\n" + verdicts("fail", 2).line[:-9])
    state = Follower(Directories([results]).all()[0]).look()
    assert (state["damaged"], state["lost_total"]) == (4, 1)


def test_stream_of_events_ends_with_the_campaign(client, running, id_of):
    place = running(verdicts("fail", 1), event("stopped", reason="wrong file"), alive=False)
    reply = client.get("/api/events", params={"c": id_of(place)})
    assert reply.headers["content-type"].startswith("text/event-stream")
    (message,) = reply.text.split("\n\n")[:-1]
    assert json.loads(message.removeprefix("data: "))["end"]["reason"] == "wrong file"


def test_stream_of_unknown_campaign_is_an_error(client):
    reply = client.get("/api/events", params={"c": "nothing"})
    assert (reply.status_code, reply.json()) == (
        404,
        {"error": "No campaign directory has this id. It may have been moved or removed."},
    )


def test_live_page_of_stopped_campaign_opens(client, running, id_of):
    place = running(alive=False)
    reply = client.get("/live", params={"c": id_of(place)})
    assert (reply.status_code, "office &lt;1&gt;" in reply.text) == (200, True)


def test_stop_leaves_the_reason_for_the_campaign(client, running, id_of):
    place = running()
    reply = client.post("/api/stop", params={"c": id_of(place)}, json={"reason": " wrong\nfile "}, headers=OWN)
    assert (reply.status_code, json.loads((place / STOP).read_text())) == (200, {"reason": "wrong file"})


@each_row("content", [b"", b"{}", b"[]", b"null", b'{"reason": 1}', b'{"reason": "  "}', b"\xff"])
def test_stop_without_reason_is_refused(client, running, id_of, content):
    place = running()
    reply = client.post("/api/stop", params={"c": id_of(place)}, content=content, headers=OWN)
    assert (reply.status_code, reply.json()) == (400, {"error": "Expected a reason why the campaign shall stop."})
    assert not (place / STOP).exists()


@each_row("headers", [{}, {"origin": "http://evil.example"}])
def test_stop_from_a_foreign_page_is_refused(client, running, id_of, headers):
    place = running()
    reply = client.post("/api/stop", params={"c": id_of(place)}, json={"reason": "x"}, headers=headers)
    assert (reply.status_code, (place / STOP).exists()) == (403, False)


def test_stop_of_an_ended_campaign_is_a_sentence(client, running, id_of):
    id = id_of(running(alive=False))
    reply = client.post("/api/stop", params={"c": id}, json={"reason": "x"}, headers=OWN)
    assert (reply.status_code, "expected a running campaign" in reply.json()["error"]) == (409, True)


def test_list_reads_no_linked_events(client, running, tmp_path):
    place = running()
    os.rename(place / EVENTS, tmp_path / "elsewhere")
    os.symlink(tmp_path / "elsewhere", place / EVENTS)
    assert "office &lt;1&gt;" not in client.get("/").text


def test_run_of_finished_campaign_is_at_its_own_page(client, add_campaign, id_of):
    id = id_of(add_campaign(20, {"room": [1]}))
    reply = client.get("/live-run", params={"c": id, "configuration": "room-1", "run": "2"})
    assert (reply.status_code, reply.headers["location"]) == (303, f"/run?c={id}&configuration=room-1&run=2")


@each_row("run", ["", "-1", "1.5", "9" * 10, "²"])
def test_run_needs_an_index(client, add_campaign, id_of, run):
    query = {"c": id_of(add_campaign(20, {"room": [1]})), "configuration": "room-1", "run": run}
    reply = client.get("/live-run", params=query)
    assert (reply.status_code, "run: expected a" in reply.text) == (400, True)


def test_link_to_a_run_of_an_unfinished_campaign_reads_no_store(client, running, id_of):
    reply = client.get("/live-run", params={"c": id_of(running()), "configuration": "room-1", "run": "0"})
    assert (reply.status_code, "Its live page opens its runs" in reply.text) == (409, True)


def test_server_believes_no_place_that_an_unfinished_campaign_names(client, results, id_of, tmp_path):
    place = unfinished_stranger(results, tmp_path / "canary")
    asked = {"c": id_of(place), "configuration": "room", "run": "0"}
    for path in ("/", "/live", "/campaign", "/live-run"):
        client.get(path, params=asked)
    reply = client.post("/live-run", params=asked, headers=OWN)
    assert (reply.status_code, "Campaigns that you began on this machine" in reply.text) == (409, True)
    assert executed(tmp_path / "canary") == []


@pytest.mark.slow
def test_run_of_running_campaign_is_shown_from_the_store(client, results, running, id_of, tmp_path):
    drawn_room(tmp_path)
    (tmp_path / "room.vast").write_text(SMALL_ROOM)
    request = {"campaign": "room.vast", "store": "store"}
    told = {"name": "office", "file": str(tmp_path / "room.vast"), "folder": str(tmp_path), "request": request}
    place = running()
    (place / EVENTS).write_bytes(event("began", **told).line)
    remember_running(final_of(place), {**told, "request": {**request, "store": str(tmp_path / "store")}})
    asked = {"c": id_of(place), "configuration": "room-2", "run": "1"}
    assert "not all of these runs are judged yet" in client.post("/live-run", params=asked, headers=OWN).text
    command = [sys.executable, "-m", "vastflow.flows.cli", "run", "room.vast", "--store", "store", "--results", "other"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=600)
    reply = client.post("/live-run", params=asked, headers=OWN)
    assert reply.status_code == 200, reply.text
    id = dict(parse_qsl(reply.json()["address"].partition("?")[2]))["c"]
    assert client.get("/").text.count("<tr>") == 2  # it is not listed
    assert client.get("/compare", params={"a": id, "b": id}).status_code == 400  # which found it
