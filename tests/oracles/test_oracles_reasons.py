"""Reasons in the report: alike ones are one row, and each design shows its own pictures."""

import re
from pathlib import Path

import pytest

from vastflow.oracles.figures.factor_figure import factor_figure, interaction_figure
from vastflow.oracles.page.failures import failure_kinds, kind_of
from vastflow.oracles.page.report import write_report
from vastflow.oracles.page.untested import rejection_rows
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.statistics.effects import Claim, FactorEffect, LevelEffect
from vastflow.oracles.statistics.interactions import InteractionEffect, LevelPair
from vastflow.oracles.statistics.intervals import Interval

WAY = [(1.0 + 0.1 * i, 2.0) for i in range(41)]
TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}


@pytest.fixture
def room(tmp_path: Path, build) -> Path:
    return build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))


def lost(build, runs: int, failed: int, reason: str = "no valid control") -> list:
    """Recordings of `runs` runs, of which the first `failed` end early; the reason has the run's number for an `@`."""
    early = [
        build.a_recording(WAY[:20], run_index=i, outcome="aborted", reason=reason.replace("@", str(i)))
        for i in range(failed)
    ]
    return early + [build.a_recording(WAY, run_index=i) for i in range(failed, runs)]


def test_reasons_that_differ_in_numbers_alone_are_of_one_kind() -> None:
    assert kind_of("stuck after 3 tries, 0.71 m away") == kind_of("stuck after 12 tries, 2 m away")
    assert kind_of("stuck after 3 tries") != kind_of("lost after 3 tries")


def test_why_runs_failed_counts_runs_and_configurations_of_each_kind(synthetic_campaign, room, build) -> None:
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=lost(build, 3, 2, "stuck after @ tries"))
    synthetic_campaign.add("a-2", "a", room, TASK, recordings=lost(build, 3, 3, "stuck after @ tries"))
    synthetic_campaign.add("a-3", "a", room, TASK, recordings=lost(build, 3, 1, "no path"))
    stuck, no_way = failure_kinds(read_tables(synthetic_campaign.write()).verdicts.reasons("fail"))
    assert (stuck["oracle"], stuck["runs"], stuck["configurations"], stuck["reasons"]) == ("success", 5, 2, 3)
    assert (no_way["runs"], no_way["configurations"], no_way["reasons"]) == (1, 1, 1)
    assert "stuck after 0 tries" in stuck["reason"]


def test_campaign_without_failures_has_no_reasons(synthetic_campaign, room, build) -> None:
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=lost(build, 2, 0))
    directory = synthetic_campaign.write()
    assert failure_kinds(read_tables(directory).verdicts.reasons("fail")) == []
    write_report(directory)
    assert "Why runs failed" not in (directory / "report.html").read_text(encoding="utf-8")


def test_rejections_that_differ_in_numbers_alone_are_one_row(synthetic_campaign, room, build) -> None:
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=lost(build, 1, 0))
    for length in (20.0, 21.0, 22.0):
        synthetic_campaign.reject("a", f"no goal at {length:.1f} m", {"path_length": length})
    synthetic_campaign.reject("a", "no free start", {"path_length": 20.0})
    first, second = rejection_rows(read_tables(synthetic_campaign.write()).rejections)
    assert (first["times"], first["reason"], first["reasons"]) == (3, "no goal at 20.0 m", 3)
    assert (second["times"], second["reasons"]) == (1, 1)


def test_each_design_of_a_family_shows_its_own_pictures(synthetic_campaign, room, build) -> None:
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


def test_few_runs_that_all_fail_are_not_called_a_finding_about_the_system(synthetic_campaign, room, build) -> None:
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=lost(build, 2, 2))
    synthetic_campaign.add("a-2", "a", room, TASK, recordings=lost(build, 2, 0))
    directory = synthetic_campaign.write()
    write_report(directory)
    page = (directory / "report.html").read_text(encoding="utf-8")
    assert "100\u00a0% of all failures" in page
    assert "not about chance" not in page


def test_levels_of_a_pair_that_are_numbers_stand_in_their_order() -> None:
    levels = [("a", "1"), ("a", "10"), ("b", "1"), ("b", "2"), ("b", "10")]
    cells = tuple(LevelPair(pair, 1, 0.5, 0.5, Interval(0.0, 1.0)) for pair in levels)
    figure = interaction_figure([InteractionEffect(("kind", "size"), cells, 0.0, 0.0, Claim(None))])
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1", "2", "10"]


def test_factor_figure_has_a_panel_for_each_factor_up_to_100_percent() -> None:
    def effect(name: str, n: int) -> FactorEffect:
        levels = tuple(LevelEffect(str(k), 1, 2, None, None, 2, 0.5, 0.5, Interval(0.2, 0.8)) for k in range(n))
        return FactorEffect(name, levels, "0", "1", 0.0, (-0.1, 0.1), 0.0, Claim(None), Claim(None))

    figure = factor_figure([effect("long", 9), effect("short", 2), effect("brief", 2)])
    figure.canvas.draw()
    boxes = [axes.get_position() for axes in figure.axes[:3]]
    assert boxes[1].x0 > boxes[0].x1 and boxes[2].y1 < boxes[0].y0
    for axes in figure.axes[:3]:
        assert axes.get_yticklabels()[-1].get_text() == "100 %" and axes.get_ylim() == (0, 1)
