"""The headline of a campaign is one sentence, the same in each place that tells of it."""

import json
import re
from html import unescape
from xml.etree import ElementTree

import pytest

from vastflow.flows.analysis.comparison import compared
from vastflow.flows.analysis.comparison_text import compared_json, compared_report, compared_text
from vastflow.flows.cli.show import show
from vastflow.flows.export.export import export
from vastflow.flows.results.summary import Results
from vastflow.flows.terminal.display import print_rows
from vastflow.flows.terminal.outcome import outcome
from vastflow.oracles.evidence.evidence import evidence_of, headline_of
from vastflow.oracles.page.report import write_report
from vastflow.oracles.results.tables import read_tables

LOSSES = {"room": [0, 1, 2, 4], "hall": [0, 0]}
RULE = {"min": 2, "max": 60, "error": 0.05, "systematic": 0.2, "reliable": 0.8}
SEARCHED = {
    "strategy": "random", "parameters": {}, "space": {"noise": {"low": 0.0, "high": 1.0}}, "direction": "maximize", "batches": 1,
    "proposals": 6, "rejected": 0, "runs": 12, "ended_by": "all points", "objective": "failure_rate", "is_rate": True,
    "best": {"configuration": "room-4", "point": {"noise": 0.4}, "objective": 1.0, "runs": 2},
    "confirmation": {"runs": 2, "samples": [1.0, 1.0], "found": 1.0},
}  # fmt: skip
FOUND = "room-4: failure rate found at 100 %, confirmed at 100 % [15, 100] on 2 fresh runs."


WHOSE = "footprint and 119 parameters from nav2.yaml; drive and mass of a TurtleBot 4 are assumed"
ROBOTS = [{"families": ["room", "hall"], "summary": WHOSE, "robot": ["the robot: mass 9 kg"]}]


@pytest.fixture
def written(add_campaign):
    """Writes a campaign with its report, as a run does."""

    def write(day, **record):
        directory = add_campaign(day, LOSSES, text="version: 1\nexecution:\n  runs: 4\n")
        file = directory / "metadata.json"
        metadata = {**json.loads(file.read_text()), "robots": ROBOTS, **record}
        file.write_text(json.dumps(metadata))
        if record.get("search"):
            from vastflow.flows.run.search_tables import ARCHIVE, EVALUATIONS
            from vastflow.oracles.results.schema import write_table

            row = {
                "configuration": "room-4",
                "batch": 0,
                "point": "{}",
                "standing": "judged",
                "objective": 1.0,
                "measures": "{}",
            }
            write_table(
                directory / "evaluations.parquet", EVALUATIONS, [{**row, "runs": 2, "simulated_s": 1.0, "reason": ""}]
            )
            write_table(directory / "archive.parquet", ARCHIVE, [])
        metadata["counts"]["headline"] = write_report(directory)
        file.write_text(json.dumps(metadata))
        return directory

    return write


def page_text(html):
    return " ".join(unescape(re.sub(r"<[^>]+>", "", html)).replace("\u2060", "").split())


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        ({}, None),
        ({"sequential": RULE}, None),
        ({"search": SEARCHED}, FOUND),
    ],
)
def test_headline_is_the_same_sentence_in_each_place(written, client, id_of, tmp_path, capsys, record, expected):
    directory, before = written(20, **record), written(19, **record)
    tables = read_tables(directory)
    text = headline_of(tables).text
    if expected is not None:
        assert text == expected
    said = {"evidence": json.loads((directory / "evidence.json").read_text())["headline"]}
    print_rows(outcome(tables, evidence_of(tables)))
    said["terminal"] = capsys.readouterr().out
    show(str(directory))
    said["show"] = capsys.readouterr().out
    (directory / "events.jsonl").write_text(
        '{"at": "2026-11-20T06:00:00+00:00", "event": "ended", "passed": 17, "failed": 7, "not_judged": 0}\n'
    )
    show(str(directory), follow=True)
    said["show --follow"] = capsys.readouterr().out
    said["notebook"] = page_text(Results(directory, None, (), ())._repr_html_())
    said["report"] = page_text((directory / "report.html").read_text())
    export(directory, tmp_path / "exported")
    root = ElementTree.parse(tmp_path / "exported" / "junit.xml").getroot()
    said["JUnit"] = root.find("properties/property[@name='headline']").get("value")
    found = compared(read_tables(before), tables)
    print_rows(compared_text(found, {}))
    said["compare"] = capsys.readouterr().out
    said["compare --json"] = compared_json(found, {})["headlines"]["after"]
    said["compare --junit"] = unescape(compared_report(found).decode())
    about = {"c": id_of(directory)}
    html = {"accept": "text/html"}
    said["explorer"] = page_text(client.get("/api/summary", params=about, headers=html).text)
    said["explorer's list"] = unescape(client.get("/").text)
    said["explorer's comparison"] = page_text(
        client.get("/compare", params={"a": id_of(before), "b": id_of(directory)}).text
    )
    assert [place for place, words in said.items() if text not in words] == []
    said["explorer's campaign"] = page_text(client.get("/campaign", params=about).text)
    places = ("terminal", "report", "explorer's campaign")
    assert [place for place in places if f"obot: {WHOSE}" not in " ".join(said[place].split())] == []


def test_search_has_no_rate_and_no_interval_of_its_points_anywhere(written, client, id_of, capsys):
    directory = written(20, search=SEARCHED, name="sought")
    evidence = json.loads((directory / "evidence.json").read_text())["all_oracles"]["campaign"]
    assert [evidence[key] for key in ("rate", "interval", "clustered")] == [None, None, None]
    rows = client.get("/api/rows", params={"c": id_of(directory)}).json()["rows"]
    assert [row["interval"] for row in rows] == [None] * 6
    found = client.get("/api/summary", params={"c": id_of(directory), "f": "noise:0.15.."}).json()["summary"]
    assert (found["interval"], found["headline"]) == (None, "9 of 16 judged runs passed")


def test_wide_table_of_a_search_parts_chosen_runs_from_fresh_ones(written):
    runs = Results(written(20, search=SEARCHED), None, (), ()).frame()
    best = runs[runs.configuration == "room-4"]
    assert best.purpose.tolist() == ["search", "search", "confirmation", "confirmation"]
    assert (runs[runs.configuration != "room-4"].purpose == "search").all()


def test_weights_of_the_wide_table_give_headline_of_stopped_runs(written):
    directory = written(20, sequential=RULE)
    runs = Results(directory, None, (), ()).frame()
    passed = (runs.passed.astype(float) * runs.weight).groupby(runs.configuration, observed=True).sum()
    of = runs.weight.groupby(runs.configuration, observed=True).sum()
    assert (passed / of).mean() == pytest.approx(headline_of(read_tables(directory)).rate)
