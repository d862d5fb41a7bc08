"""Parts of pages that the server fills in, as the pages ask for them."""

import json
from datetime import datetime

import pytest
from table import each_row

from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.results.events import EVENTS, Event
from vastflow.oracles.results.tables import read_tables

HTML = {"Accept": "text/html"}
EVIL = "<img src=x onerror=alert(1)>"


@pytest.fixture
def campaign(add_campaign, id_of):
    """The id of a campaign of twelve runs, with a family whose name is HTML."""
    directory = add_campaign(3, {EVIL: [0], "hard": [4, 2]})
    write_wide(directory, wide_table(read_tables(directory)))
    return id_of(directory)


@each_row(
    ("view", "query", "words"),
    [
        ("summary", {}, ["<b>50 % passed; ", "6 failed", "all 12 runs", '<button class="link"']),
        (
            "summary",
            {"f": "passed=fail"},
            ["<b>0 % passed</b>", "passed: fail ✕</button>", "6 of 12 runs", "Clear all"],
        ),
        ("summary", {"f": "noise:0.1.."}, ["noise ≥ 0.1 ✕"]),
        ("summary", {"f": "noise:..0.15"}, ["noise ≤ 0.15 ✕"]),
        ("summary", {"f": "noise:0.1..0.2"}, ["noise: 0.1 to 0.2 ✕"]),
        ("summary", {"f": "configuration*har"}, ["configuration contains “har” ✕"]),
        ("facets", {"f": "family=hard"}, ['value="hard" data-key="family hard" checked', "<h3>passed</h3>"]),
        ("facets", {"f": "configuration*har"}, ['value="har" data-key="search"']),
        ("rows", {"sort": "rate"}, ['aria-sort="ascending"', "hard-1", "1–3 of 3 configurations"]),
        ("rows", {"count": "1", "start": "1"}, ["2–2 of 3 configurations", "start=2"]),
    ],
)
def test_part_has_the_selection(client, campaign, view, query, words):
    reply = client.get(f"/api/{view}", params={"c": campaign, **query}, headers=HTML)
    assert (reply.status_code, reply.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert [each for each in words if each not in reply.text] == []


def test_facet_rounds_number_of_many_digits_and_title_has_it_whole(client, add_campaign, id_of):
    directory = add_campaign(3, {"hard": [4, 2, 1, 0]})
    write_wide(directory, wide_table(read_tables(directory)))
    page = client.get("/api/facets", params={"c": id_of(directory)}, headers=HTML).text
    assert "<span>0.3</span>" in page and 'title="0.30000000000000004: ' in page
    assert 'value="0.30000000000000004"' in page and 'title="0.1: ' not in page


@each_row("view", ["summary", "facets", "rows"])
def test_part_escapes_names(client, campaign, view):
    reply = client.get(f"/api/{view}", params={"c": campaign, "f": f"family={EVIL}"}, headers=HTML)
    assert "&lt;img" in reply.text and "<img" not in reply.text


def test_values_are_sent_to_programs(client, campaign):
    assert client.get("/api/rows", params={"c": campaign}).json()["total"] == 3


def test_refused_part_is_a_sentence_for_the_page(client, campaign):
    reply = client.get("/api/rows", params={"c": campaign, "f": "nothing=1"}, headers=HTML)
    assert reply.json()["error"].startswith("expected a column of this campaign")


def test_configuration_page_has_its_values(client, campaign):
    page = client.get("/configuration", params={"c": campaign, "name": "hard-2"}).text
    assert "50.0 % passed (2 of 4 judged runs)" in page and "Nearest configuration that passes" in page
    assert f">{EVIL}" not in page and "&lt;img src=x onerror=alert(1)&gt;-1</a>: 4 of 4 judged runs passed." in page
    assert page.count(">Run ") == 4


def test_event_stream_has_parts_of_the_page(client, results, id_of, add_campaign):
    directory = add_campaign(3, {"room": [1]})
    told = [
        {"event": "began", "name": "office"},
        {
            "event": "verdicts",
            "configuration": EVIL,
            "family": "room",
            "judgment": "fail",
            "reason": EVIL,
            "runs": [3],
        },
        {"event": "ended"},
    ]
    now = datetime.now().astimezone()
    lines = [Event(now, str(each.pop("event")), each).line for each in told]
    (directory / EVENTS).write_bytes(b"".join(lines))
    reply = client.get("/api/events", params={"c": id_of(directory)})
    html = json.loads(reply.text.removeprefix("data: ").strip())["html"]
    assert "The campaign is finished." in html and 'class="fail"' in html
    assert "<img" not in html and "&amp;run=3" in html
