"""Sections of the report on reasons, designs, and searches, its figures of factors, and the headline."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from vastflow.flows.results.summary import Results
from vastflow.oracles.evidence.findings import findings_of
from vastflow.oracles.figures.charts import factor_figure, interaction_figure
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.failures import cases, failure_kinds, kind_of
from vastflow.oracles.page.headline import headline_html
from vastflow.oracles.page.report import write_report
from vastflow.oracles.page.search_section import CELLS_DRAWN, search_section
from vastflow.oracles.page.sections import rejection_rows
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.statistics.effects import Claim, FactorEffect, InteractionEffect, LevelEffect, LevelPair
from vastflow.oracles.statistics.intervals import Interval

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
ALONG = [(1.0 + 0.1 * k, 2.0) for k in range(41)]


@pytest.fixture
def room(tmp_path, build):
    return build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))


def lost(build, runs, failed, reason="no valid control"):
    """Recordings of `runs` runs, of which the first `failed` end early; the reason has the run's number for an `@`."""
    early = [
        build.a_recording(ALONG[:20], run_index=i, outcome="aborted", reason=reason.replace("@", str(i)))
        for i in range(failed)
    ]
    return early + [build.a_recording(ALONG, run_index=i) for i in range(failed, runs)]


def test_reasons_that_differ_in_numbers_are_of_one_kind(synthetic_campaign, room, build):
    assert kind_of("stuck after 3 tries, 0.71 m away") == kind_of("stuck after 12 tries, 2 m away")
    assert kind_of("stuck after 3 tries") != kind_of("lost after 3 tries")
    for k, (failed, reason) in enumerate(((2, "stuck after @ tries"), (3, "stuck after @ tries"), (1, "no path"))):
        synthetic_campaign.add(f"a-{k}", "a", room, TASK, recordings=lost(build, 3, failed, reason))
    for length in (20.0, 21.0, 22.0):
        synthetic_campaign.reject("a", f"no goal at {length:.1f} m", {"path_length": length})
    synthetic_campaign.reject("a", "no free start", {"path_length": 20.0})
    tables = read_tables(synthetic_campaign.write())
    stuck, no_path = failure_kinds(tables.verdicts.reasons("fail"))
    assert (stuck["oracle"], stuck["runs"], stuck["configurations"], stuck["reasons"]) == ("success", 5, 2, 3)
    assert (no_path["runs"], no_path["configurations"], no_path["reasons"]) == (1, 1, 1)
    assert "stuck after 0 tries" in stuck["reason"]
    first, second = rejection_rows(tables.rejections)
    assert (first["times"], first["reason"], first["reasons"]) == (3, "no goal at 20.0 m", 3)
    assert (second["times"], second["reasons"]) == (1, 1)


def test_campaign_without_failures_has_no_reasons(synthetic_campaign, room, build):
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=lost(build, 2, 0))
    directory = synthetic_campaign.write()
    assert failure_kinds(read_tables(directory).verdicts.reasons("fail")) == []
    write_report(directory)
    assert "Why runs failed" not in (directory / "report.html").read_text(encoding="utf-8")


def test_designs_of_family_show_their_own_figures(synthetic_campaign, room, build):
    for k in range(16):
        factors = {"noise": (0.0, 0.1)[k % 2], "step": (1, 2)[k // 2 % 2]} | ({"late": k // 4 % 2} if k >= 8 else {})
        synthetic_campaign.add(f"a-{k + 1}", "a", room, TASK, recordings=lost(build, 3, 3 * (k % 2)), factors=factors)
    directory = synthetic_campaign.write()
    write_report(directory)
    page = (directory / "report.html").read_text(encoding="utf-8")
    section = page[page.index("All factors, with intervals") : page.index('<details class="fold"')]
    headings = [" ".join(heading.split()) for heading in re.findall(r"<h3>(.*?)</h3>", section, re.DOTALL)]
    assert headings == ["a, without late", "a, with late"]
    first, second = section.split("<h3>")[1:]
    assert (first.count("figures/factors-1.svg"), first.count("figures/factors-2.svg")) == (1, 0)
    assert (second.count("figures/factors-1.svg"), second.count("figures/factors-2.svg")) == (0, 1)


def test_few_failed_runs_are_no_finding_about_system(synthetic_campaign, room, build):
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=lost(build, 2, 2))
    synthetic_campaign.add("a-2", "a", room, TASK, recordings=lost(build, 2, 0))
    directory = synthetic_campaign.write()
    write_report(directory)
    page = (directory / "report.html").read_text(encoding="utf-8")
    assert "100\u00a0% of all failures" in page
    assert "not about chance" not in page


def test_interaction_figure_orders_numbers():
    levels = [("a", "1"), ("a", "10"), ("b", "1"), ("b", "2"), ("b", "10")]
    cells = tuple(LevelPair(pair, 1, 0.5, 0.5, Interval(0.0, 1.0)) for pair in levels)
    figure = interaction_figure([InteractionEffect(("kind", "size"), cells, 0.0, 0.0, Claim(None))])
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1", "2", "10"]


def test_factor_figure_has_panel_for_each_factor():
    def effect(name: str, n: int) -> FactorEffect:
        levels = tuple(LevelEffect(str(k), 1, 2, None, None, 2, 0.5, 0.5, Interval(0.2, 0.8)) for k in range(n))
        return FactorEffect(name, levels, "0", "1", 0.0, (-0.1, 0.1), 0.0, Claim(None), Claim(None))

    figure = factor_figure([effect("long", 9), effect("short", 2), effect("brief", 2)])
    figure.canvas.draw()
    boxes = [axes.get_position() for axes in figure.axes[:3]]
    assert boxes[1].x0 > boxes[0].x1 and boxes[2].y1 < boxes[0].y0
    for axes in figure.axes[:3]:
        assert axes.get_yticklabels()[-1].get_text() == "100 %" and axes.get_ylim() == (0, 1)


class Tags(HTMLParser):
    def __init__(self, page):
        super().__init__()
        self.open, self.images, self.text = [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.images.append(dict(attrs)["src"])
        else:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_headline_shows_rate_causes_and_figures(synthetic_campaign, tmp_path, room, build):
    failed = build.a_recording(ALONG[:20], run_index=1, outcome="aborted", error_xy_m=(0.0, 0.8))
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(ALONG), failed])
    directory = synthetic_campaign.write()
    write_report(directory)
    html = Results(directory, None, (), ())._repr_html_()
    page = Tags(html)
    assert page.open == []
    assert "50\N{NO-BREAK SPACE}% of the judged runs passed: 1 of 2, 0 not judged overall." in page.text
    assert "Lost" in page.text and "vastflow replay . a-1 1" in page.text
    assert len(page.images) == 2 and all(image.startswith("data:image/png;base64,") for image in page.images)
    assert not re.search(r"<script|https?://", html)
    assert html == headline_html(directory)
    assert Results(tmp_path / "gone", None, (), ())._repr_html_() is None


SEARCHED = {"start_pose": {"x": 1.0, "y": 1.0, "yaw": 0.0}, "goal_pose": {"x": 4.0, "y": 1.0, "yaw": 0.0}}
PATH = np.array([[1.0, 1.0], [2.0, 1.0], [4.0, 1.0]])
COUNT = CELLS_DRAWN + 2


def test_search_section_draws_runs_of_worst_cells(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(5.0, 4.0))
    for k in range(COUNT):
        obstacles = [build.box_at(3.0, 1.5 + 0.2 * k)]
        recordings = [build.a_recording(PATH)]
        synthetic_campaign.add(f"point-{k}", "search", room, SEARCHED, recordings=recordings, obstacles=obstacles)
    archive = {"measures": {"x": {"low": 0, "high": 10}, "y": {"low": 0, "high": 10}}}
    best = {"configuration": "point-3", "point": {}, "objective": 1.0, "runs": 1}
    said = {"strategy": "qd", "parameters": {"archive": archive}, "space": {}, "objective": "failure_rate"}
    said |= {"is_rate": True, "direction": "maximize", "batches": 1, "proposals": COUNT, "rejected": 0}
    said |= {"runs": COUNT, "ended_by": "runs"}
    synthetic_campaign.metadata = {"search": {**said, "best": best, "confirmation": None}}
    directory = synthetic_campaign.write()
    objectives = [0.1, 0.5, 0.2, 1.0, 0.3, 0.4]
    evaluations = [{"configuration": f"point-{k}", "objective": objectives[k], "runs": 1} for k in range(COUNT)]
    pq.write_table(pa.Table.from_pylist(evaluations), directory / "evaluations.parquet")
    cells = [
        {**each, "cell": json.dumps([k, 0]), "measures": json.dumps({"x": k + 0.5, "y": 0.0})}
        for k, each in enumerate(evaluations)
    ]
    pq.write_table(pa.Table.from_pylist(cells), directory / "archive.parquet")
    section = search_section(Facts(read_tables(directory)))
    assert [each.name for each in section.pictures] == [
        *("search-progress", "search-archive"),
        *("cell-point-3", "cell-point-1", "cell-point-5", "cell-point-4"),
    ]
    assert section.pictures[2].title == "point-3: failure rate 1"
    assert section.pictures[2].caption == "The best point at x 3.5, y 0."


def test_report_of_search_claims_no_factors(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(5.0, 4.0))
    for k in range(12):
        recordings = [build.a_recording(PATH, run_index=n) for n in range(6)]
        if k % 2:
            recordings[:5] = [replace(each, run=replace(each.run, outcome="timed_out")) for each in recordings[:5]]
        name, task = f"point-{k}", {**SEARCHED, "goal_pose": {"x": 4.0, "y": 1.0 + 0.01 * k, "yaw": 0.0}}
        synthetic_campaign.add(name, "search", room, task, recordings=recordings, factors={"noise": k % 2})
    directory = synthetic_campaign.write()
    write_report(directory)
    assert "noise matters" in (directory / "report.html").read_text()
    metadata = json.loads((directory / "metadata.json").read_text())
    said = {"strategy": "random", "parameters": {}, "space": {}, "objective": "failure_rate", "direction": "maximize"}
    said |= {"batches": 1, "proposals": 12, "rejected": 0, "runs": 72, "ended_by": "runs", "best": None}
    (directory / "metadata.json").write_text(json.dumps({**metadata, "search": said}))
    pq.write_table(pa.table({"configuration": pa.array([], pa.string())}), directory / "evaluations.parquet")
    write_report(directory)
    page = (directory / "report.html").read_text()
    assert "noise matters" not in page and "account for" not in page
    assert json.loads((directory / "evidence.json").read_text())["factors"] == []


def test_cases_order_configurations_by_lower_bounds(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(5.0, 4.0))
    for name, failed, runs in (("one-of-one", 1, 1), ("nine-of-ten", 9, 10)):
        recordings = [build.a_recording(PATH, run_index=n) for n in range(runs)]
        recordings[:failed] = [
            replace(each, run=replace(each.run, outcome="timed_out")) for each in recordings[:failed]
        ]
        task = {**SEARCHED, "goal_pose": {"x": 4.0, "y": 1.0 + 0.1 * runs, "yaw": 0.0}}
        synthetic_campaign.add(name, "search", room, task, recordings=recordings)
    tables = read_tables(synthetic_campaign.write())
    assert [tables.configurations.names[k] for k in cases(tables, findings_of(tables))] == ["nine-of-ten", "one-of-one"]
