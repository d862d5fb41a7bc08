"""The comparison page: which campaigns it takes, and what it says of them."""

import re
import shutil

import pytest
from table import each_row


@pytest.fixture
def two(add_campaign, id_of):
    """Ids of two campaigns; in the later one the first configuration of `room` newly fails all runs."""
    older = add_campaign(20, {"room": [0, 1, 0], "aisle": [0]})
    newer = add_campaign(21, {"room": [4, 1, 0], "aisle": [0]})
    return id_of(older), id_of(newer)


def test_comparison_names_baseline_candidate_and_changed_configurations(client, two):
    page = client.get("/compare", params={"a": two[0], "b": two[1]}).text
    assert re.search(r"baseline</td><td class=\"name\">.*2026-11-20 06:00", page)
    assert "16 pairs of runs" in page
    assert re.search(r"room-1</a>.*?4 of 4</td>.*?0 of 4</td>", page, re.DOTALL)
    assert (
        f"/run?c={two[0]}&amp;configuration=room-1&amp;run=2&amp;with=room-1&amp;withrun=2&amp;withc={two[1]}" in page
    )


def test_comparison_shows_signed_points_with_interval(client, two):
    page = client.get("/compare", params={"a": two[0], "b": two[1]}).text
    assert "93.8 %" in page and "68.8 %" in page and "−25.0" in page


def test_comparison_draws_a_changed_configuration(client, two):
    reply = client.get("/api/compare.png", params={"a": two[0], "b": two[1], "configuration": "room-1"})
    assert (reply.status_code, reply.content[:4]) == (200, b"\x89PNG")
    reply = client.get("/api/compare.png", params={"a": two[0], "b": two[1], "configuration": "../room-1"})
    assert (reply.status_code, reply.json()["error"]) == (
        409,
        "../room-1: expected a configuration with changed outcomes",
    )


@each_row(
    ("query", "status", "words"),
    [
        ({"b": "nothing"}, 404, "No campaign directory has this id"),
        ({"b": None}, 400, "Expected two campaigns, got one twice."),
        ({"margin": "-1"}, 400, "Expected a margin of 0 to 100 points"),
        ({"margin": "nan"}, 400, "Expected a margin of 0 to 100 points"),
        ({"target": "all"}, 400, "Expected `these` or `others`"),
        ({"oracle": "<b>"}, 409, "No oracle &#39;&lt;b&gt;&#39; judged both campaigns"),
    ],
)
def test_comparison_refuses_wrong_questions_in_a_sentence(client, two, query, status, words):
    asked = {"a": two[0], "b": two[1]} | query
    reply = client.get("/compare", params=asked | ({"b": two[0]} if asked["b"] is None else {}))
    assert (reply.status_code, words in reply.text) == (status, True)


def test_comparison_reports_lack_of_common_scenarios(client, two, add_campaign, id_of):
    other = add_campaign(22, {"yard": [0] * 9}, name="yard")
    shutil.rmtree(other / "environments")
    reply = client.get("/compare", params={"a": two[0], "b": id_of(other)})
    assert reply.status_code in (200, 409) and "Traceback" not in reply.text


@each_row("file", ["verdicts.parquet", "configurations.parquet", "campaign.vast"])
def test_comparison_with_damaged_table_is_a_sentence(client, add_campaign, id_of, two, file):
    broken = add_campaign(23, {"room": [1]}, name=f"broken-{file.partition('.')[0]}")
    id = id_of(broken)
    (broken / file).write_bytes(b"\0")
    (broken / file).chmod(0o600)
    if file == "campaign.vast":
        (broken / file).unlink()
    reply = client.get("/compare", params={"a": two[0], "b": id})
    assert (reply.status_code, "damaged campaign directory" in reply.text) == (409, True)


def test_comparison_with_directory_deleted_meanwhile_is_a_sentence(client, add_campaign, id_of, two):
    gone = add_campaign(24, {"room": [1]})
    id = id_of(gone)
    assert client.get("/compare", params={"a": two[0], "b": id}).status_code == 200
    shutil.rmtree(gone)
    assert client.get("/compare", params={"a": two[0], "b": id}).status_code == 404
