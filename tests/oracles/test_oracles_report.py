"""The report and the evidence of a synthetic campaign directory."""

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from PIL import Image
from table import each_row

from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.rates import Counts, Interval
from vastflow.oracles.page import report
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import picture
from vastflow.oracles.page.report import write_report
from vastflow.oracles.page.section import Section, soft
from vastflow.oracles.page.table import Column, Table, rate_cell, rate_words
from vastflow.oracles.page.words import number, percent, points, span
from vastflow.oracles.results.tables import read_tables

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
LINE = [(1.0 + 0.1 * i, 2.0) for i in range(41)]
REASON = "no goal at 200 m ± 0.5 m <from> here & now"
VOID = {"meta", "br", "img", "link", "hr", "input"}


class Page(HTMLParser):
    """Reads a page, and notes what a browser would fetch and tags that are not closed in order."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.misnested: list[str] = []
        self.addresses: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.ids: set[str] = set()
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.addresses += [values[name] or "" for name in ("src", "href", "data", "srcset") if name in values]
        if tag == "img":
            self.images.append(values)
        if values.get("id"):
            self.ids.add(values["id"] or "")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.misnested.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def shown(tmp_path_factory, build: SimpleNamespace) -> Path:
    """A directory with its report, that all tests read and none writes to.

    Two families: one passes and loses runs to a fault, one fails partly; rejections and a duplicate.
    """
    folder = tmp_path_factory.mktemp("shown")
    room = build.write_map(folder / "room", build.walled_room(6.0, 4.0))
    oracles = [("performance", {}), ("safety", {})]
    passing = [build.a_recording(LINE, run_index=i) for i in range(5)]
    mixed = passing[:3] + [
        build.a_recording(LINE[:20], run_index=i, outcome="aborted", reason="no valid control") for i in (3, 4)
    ]
    campaign = build.campaign(folder / "results")
    campaign.add("quiet-1", "quiet", room, TASK, recordings=passing, oracles=oracles, factors={"noise": 0.0})
    campaign.add("quiet-2", "quiet", room, TASK, oracles=oracles, fault="fault: MemoryError", runs=5)
    campaign.add("noisy-1", "noisy", room, TASK, recordings=mixed, oracles=oracles, factors={"noise": 0.1})
    campaign.add(
        "noisy-2",
        "noisy",
        room,
        TASK,
        recordings=passing,
        obstacles=[build.box_at(3.0, 2.4)],
        oracles=oracles,
        factors={"noise": 0.1},
    )
    campaign.add("noisy-3", "noisy", room, TASK, duplicate_of="noisy-1")
    campaign.reject("quiet", REASON, {"path_length": 200.0})
    campaign.reject("quiet", REASON, {"path_length": 201.0})
    campaign.metadata = {
        "notes": ["a.vast:3:1: execution.image: not executed by this version"],
        "robots": [{"families": ["quiet", "noisy"], "robot": ["the robot: mass 9 kg", "assumed: speed up to 0.5 m/s"]}],
        "faults": [{"configuration": "quiet-2", "run_index": None, "stage": "execute", "error": "MemoryError"}],
    }
    directory = campaign.write("version: 1\n# see https://example.org\n")
    write_report(directory)
    return directory


@pytest.fixture
def directory(shown: Path, tmp_path: Path) -> Path:
    """A copy of the directory that is shown."""
    return Path(shutil.copytree(shown, tmp_path / "results"))


def text_of(directory: Path) -> str:
    return (directory / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(shown: Path) -> Page:
    return Page(text_of(shown))


def test_every_tag_of_the_report_is_closed_in_order(page: Page) -> None:
    assert (page.misnested, page.open) == ([], [])


def test_report_fetches_nothing(page: Page, shown: Path) -> None:
    assert page.addresses
    inside = ("data:image/png;base64,", "data:image/svg+xml;base64,", "#")
    links = {address for address in page.addresses if not address.startswith(inside)}
    assert {link for link in links if not link.startswith("figures/")} == set()
    text = text_of(shown)
    assert not re.search(r"@import|url\(|<link|<script[^>]*src|fetch\(|XMLHttp|import\(", text)


def test_links_to_figures_lead_to_files_beside_the_report(page: Page, shown: Path) -> None:
    links = {address for address in page.addresses if address.startswith("figures/")}
    assert {Path(link).suffix for link in links} == {".png", ".svg"}
    assert all((shown / link).is_file() for link in links)
    text = text_of(shown)
    assert text.count('href="figures/') == text.count('title="In the folder figures/ beside report.html"') > 0


def test_links_within_the_report_lead_somewhere(page: Page) -> None:
    assert {address[1:] for address in page.addresses if address.startswith("#")} <= page.ids


def test_pictures_say_what_they_show(page: Page) -> None:
    assert len(page.images) == 10  # rates, factors, four of the map, two configurations that failed, two causes
    assert all(image["alt"] for image in page.images)


def test_figures_are_written_as_png_and_svg_too(page: Page, shown: Path) -> None:
    files = sorted((shown / "figures").iterdir())
    names = {re.sub(r"-[0-9a-f]{8}$", "", file.stem) for file in files}
    assert names == {
        "rates",
        "factors",
        "final-poses",
        "failure-rate",
        "failed",
        "passed",
        "case-noisy-1",
        "cause-too-close",
        "cause-no-path",
        "case-noisy-2",
    }
    for file in files:
        if file.suffix == ".png":
            with Image.open(file) as picture:
                assert picture.width >= 600
        else:
            assert ElementTree.parse(file).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert [file.suffix for file in files] == [".png", ".svg"] * len(names)


def test_worst_configurations_are_shown_with_the_command_that_replays_them(page: Page) -> None:
    assert page.text.index("vastflow replay . noisy-2 0") < page.text.index("vastflow replay . noisy-1 3")


def test_what_belongs_to_the_call_alone_stands_between_marks(directory: Path) -> None:
    def rest() -> str:
        marks = r"<!-- when -->(.*?)<!-- /when -->|<!-- work -->(.*?)<!-- /work -->"
        parts = re.split(marks, text_of(directory), flags=re.DOTALL)
        assert "lab" in parts[5]
        return parts[0] + parts[3] + parts[6]

    first = rest()
    metadata = json.loads((directory / "metadata.json").read_text())
    metadata |= {"created": "2027-01-01T00:00:00", "host": {"name": "lab 2", "memory_bytes": 25_276_502_016}}
    metadata["counts"] = {"executed": 7, "reused": 8, "cpu_s": 9.0, "wall_s": 10.0, "results": "/elsewhere"}
    (directory / "metadata.json").write_text(json.dumps(metadata))
    write_report(directory)
    assert rest() == first
    page = text_of(directory)
    assert "<dt>host memory</dt><dd>25.3 GB</dd>" in page and "<dt>CPU time</dt><dd>9 s</dd>" in page
    assert "<dt>runs</dt><dd>7 executed, 8 from the store</dd>" in page


def test_rows_of_a_table_are_data_that_a_script_can_read(shown: Path) -> None:
    (data,) = re.findall(r'<script type="application/json" id="data-configurations">(.*?)</script>', text_of(shown))
    assert json.loads(data)["kinds"][:4] == ["text", "choice", "class", "rate"]
    assert [row[0] for row in json.loads(data)["rows"]] == ["noisy-2", "noisy-1", "quiet-1", "quiet-2"]
    assert json.loads(data)["rows"][1][3][:3] == [3, 5, 0]


def test_campaign_that_was_stopped_early_says_how_many_runs_that_saved(directory: Path) -> None:
    metadata = json.loads((directory / "metadata.json").read_text())
    (directory / "metadata.json").write_text(json.dumps({**metadata, "sequential": {"min": 3, "max": 20}}))
    write_report(directory)
    page = Page(text_of(directory))
    text = " ".join(page.text.split())
    assert "60 of 80 runs were saved" in text
    assert "those that took longest to decide count most" in text


def test_sample_and_a_selection_are_said_at_the_top(directory: Path) -> None:
    metadata = json.loads((directory / "metadata.json").read_text())
    metadata |= {"counts": {"sampled_from": 1234}, "asked": {"runs": 5, "sample": 4, "only": ["noisy*"]}}
    (directory / "metadata.json").write_text(json.dumps(metadata))
    write_report(directory)
    words = " ".join(Page(text_of(directory)).text.split())
    assert "A sample: 4 of 1,234 distinct configurations of the campaign" in words
    assert "Only this part of the campaign was requested: noisy*." in words


def test_duplicates_are_counted_beside_as_the_paper_counts_them(page: Page, shown: Path) -> None:
    # noisy-3 is noisy-1: its 3 of 5 count twice, 5 + 2 · 3 + 0 of 5 + 2 · 5 + 5.
    assert "55\u00a0% 11 of 20" in page.text
    assert json.loads((shown / "evidence.json").read_text())["weighted"]["counts"]["passed"] == 11


def test_evidence_has_classes_total_failures_and_factors(page: Page, shown: Path) -> None:
    evidence = json.loads((shown / "evidence.json").read_text())
    assert evidence["classes"]["configurations"]["noisy-2"] in ("systematic", "undecided")
    assert evidence["total_failures"] | {"share": None} == {
        "configurations": 1, "failures": 5, "of_failures": 7, "share": None
    }  # fmt: skip
    assert [factor["name"] for factor in evidence["factors"][0]["factors"]] == [
        "family"
    ]  # which divides them as noise does


def test_every_basis_of_robustness_is_tabulated_beside_the_one_that_judges(synthetic_campaign, tmp_path, build) -> None:
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    synthetic_campaign.add(
        "a-1", "a", room, TASK, recordings=[build.a_recording(LINE)], oracles=[("robustness", {"basis": "maximum"})]
    )
    synthetic_campaign.metadata = {"oracles": [{"name": "robustness", "parameters": {"basis": "maximum"}}]}
    directory = synthetic_campaign.write()
    write_report(directory)
    page = Page(text_of(directory))
    assert "maximum, judged by" in page.text
    assert "sum over meters driven" in page.text


def test_rejections_are_shown_with_their_reason_and_how_often(page: Page) -> None:
    assert REASON in page.text
    assert "path_length 200; path_length 201" in page.text


def test_what_was_left_out_is_said_at_the_top(page: Page) -> None:
    summary = " ".join(page.text.split())
    unjudged = "5 runs not judged overall (5 by success, 5 by performance, 5 by safety)"
    assert f"2 rejected requests, 1 duplicate, {unjudged}, 1 fault, 1 note" in summary


def test_not_judged_faults_duplicates_and_notes_are_named(page: Page) -> None:
    for what in ("fault: MemoryError", "noisy-3 is noisy-1", "execution.image: not executed by this version"):
        assert what in page.text


def test_method_says_what_the_robot_is_and_what_of_it_is_assumed(page: Page) -> None:
    for what in ("quiet, noisy", "The robot: mass 9 kg.", "Assumed: speed up to 0.5 m/s."):
        assert what in page.text


def test_headline_counts_judged_runs_alone(page: Page) -> None:
    # quiet-1: 5 of 5; noisy-1: 3 of 5; noisy-2: 0 of 5, too close to the box.
    assert "of the judged runs passed every oracle: 8 of 15." in page.text


def test_evidence_has_rates_and_intervals_for_campaign_family_and_configuration(page: Page, shown: Path) -> None:
    evidence = json.loads((shown / "evidence.json").read_text())
    together = evidence["all_oracles"]
    assert list(evidence["oracles"]) == ["success", "performance", "safety"]
    assert (together["campaign"]["passed"], together["campaign"]["failed"], together["campaign"]["not_judged"]) == (
        8,
        7,
        5,
    )
    assert together["families"]["noisy"]["rate"] == pytest.approx(0.3)
    assert together["families"]["quiet"]["clustered"] is None
    assert together["configurations"]["quiet-1"]["interval"] == pytest.approx({"low": 0.5655, "high": 1.0}, abs=1e-4)
    assert together["configurations"]["quiet-1"]["exact"] == pytest.approx({"low": 0.025 ** (1 / 5), "high": 1.0})
    assert together["configurations"]["quiet-2"]["exact"] == {"low": 0.0, "high": 1.0}
    assert together["configurations"]["quiet-2"]["rate"] is None
    assert evidence["oracles"]["success"]["families"]["noisy"]["passed"] == 8
    assert evidence["oracles"]["success"]["metrics"]["final_distance"]["n"] == 15
    assert (evidence["rejected"], evidence["duplicates"]) == (2, {"noisy-3": "noisy-1"})


def test_duplicate_is_counted_once(shown: Path) -> None:
    family = evidence_of(read_tables(shown))[None].families["noisy"]
    assert (family.configurations, family.counts.judged) == (2, 10)


def test_report_can_be_written_again(shown: Path, directory: Path) -> None:
    write_report(directory)
    assert text_of(directory) == text_of(shown)


def test_what_a_user_has_set_for_matplotlib_changes_no_picture(directory: Path) -> None:
    before = {file.name: file.read_bytes() for file in (directory / "figures").iterdir()}
    shutil.rmtree(directory / "figures")
    with matplotlib.rc_context({"font.size": 30, "axes.facecolor": "black", "savefig.bbox": "tight"}):
        write_report(directory)
        assert matplotlib.rcParams["font.size"] == 30
    assert {file.name: file.read_bytes() for file in (directory / "figures").iterdir()} == before


def test_campaign_of_which_nothing_could_be_built_has_a_report(synthetic_campaign) -> None:
    synthetic_campaign.reject("far", REASON, {"path_length": 200.0})
    directory = synthetic_campaign.write()
    write_report(directory)
    page = Page(text_of(directory))
    assert "Nothing was run: no configuration could be built." in page.text
    assert REASON in page.text
    assert page.misnested == []


def test_campaign_whose_every_run_broke_has_a_report(synthetic_campaign, tmp_path: Path, build) -> None:
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(LINE)])
    synthetic_campaign.verdicts = [{**row, "judgement": "not judged"} for row in synthetic_campaign.verdicts]
    directory = synthetic_campaign.write()
    write_report(directory)
    assert json.loads((directory / "evidence.json").read_text())["all_oracles"]["campaign"]["rate"] is None


@each_row(
    ("rate", "text"),
    [
        (None, "–"),
        (0.0, "0\u00a0%"),
        (1.0, "100\u00a0%"),
        (0.857, "86\u00a0%"),
        (0.9991, "99.9\u00a0%"),
        (0.0004, "0.04\u00a0%"),
    ],
)
def test_rate_is_never_rounded_to_none_or_all(rate: float | None, text: str) -> None:
    assert percent(rate) == text


def test_interval_is_written_with_one_sign_and_rounded_outwards() -> None:
    assert span(Interval(0.523, 0.704)).replace("\u2060", "") == "52–71\u00a0%"
    assert span(Interval(0.0, 1.0)).replace("\u2060", "") == "0–100\u00a0%"
    assert span(Interval(0.29, 0.57)).replace("\u2060", "") == "29–57\u00a0%"


@each_row(("difference", "text"), [(0.124, "+12"), (-0.5, "−50"), (-0.004, "+0"), (0.0, "+0")])
def test_difference_has_its_sign_and_nothing_is_not_less_than_nothing(difference: float, text: str) -> None:
    assert points(difference) == text


def test_ninety_five_of_a_hundred_and_twenty_have_one_interval_in_headline_and_table() -> None:
    counts = Counts(95, 25)  # 71.067 to 85.450 %: what is rounded to 85.5 first must not become 86 here and 85 there
    assert span(counts.interval) == rate_words(rate_cell(counts))["span"]


@given(st.integers(0, 300), st.integers(0, 300))
def test_interval_is_the_same_in_headline_and_table_and_holds_what_was_computed(passed: int, failed: int) -> None:
    counts = Counts(passed, failed)
    if counts.judged:
        shown = span(counts.interval)
        assert shown == rate_words(rate_cell(counts))["span"]
        low, high = (float(end) / 100 for end in shown.replace("\u2060", "").removesuffix("\u00a0%").split("–"))
        assert low <= counts.interval.low + 1e-8 and counts.interval.high - 1e-8 <= high


def test_narrow_interval_has_a_digit_more() -> None:
    assert span(Interval(0.7601, 0.7649)).replace("\u2060", "") == "76.0–76.5\u00a0%"
    assert rate_words([760, 1000, 0, 757, 762])["span"].replace("\u2060", "") == "75.7–76.2\u00a0%"
    assert rate_words([5, 10, 0, 237, 763])["span"].replace("\u2060", "") == "23–77\u00a0%"


@each_row(("value", "text"), [(None, "–"), (1e-15, "0"), (-1e-15, "0"), (0.0582, "0.058"), (1234.5, "1,234")])
def test_number_is_rounded_to_the_millimeter(value: float | None, text: str) -> None:
    assert number(value) == text


NOISE = {"combinations": 4, "admissible": 3, "covered": 2, "share": 2 / 3}
COVERAGE_COUNTS = {
    "requested": 1234,
    "excluded": 1100,
    "unrealisable": 30,
    "duplicate": 4,
    "realised": 100,
    "valid": 130,
    "share": 100 / 130,
}
COVERAGE = {
    **COVERAGE_COUNTS,
    "t_way": {"strength": 2, **NOISE},
    "families": {
        "quiet": {
            **COVERAGE_COUNTS,
            "design": {"kind": "t_way", "strength": 2, "rows": 104, "product": 9000, "lower_bound": 96},
            "excluded_by": {"see_<enough>": 1100},
            "unrealisable_by": {"PathVariationRandom": {"count": 30, "reasons": {REASON: 30}, "reasons_not_listed": 0}},
            "dimensions": {"system": {"factors": ["noise", "radius"], "distinct": 2, **NOISE}},
            "t_way": {
                "strength": 2,
                **NOISE,
                "pairs": [{"factors": ["noise", "radius"], **NOISE}],
                "pairs_not_listed": 7,
            },
        }
    },
}


@pytest.fixture(scope="module")
def covered(shown: Path, tmp_path_factory) -> Path:
    """A directory with a table of its coverage, and its report."""
    directory = Path(shutil.copytree(shown, tmp_path_factory.mktemp("covered") / "results"))
    (directory / "coverage.json").write_text(json.dumps(COVERAGE))
    write_report(directory)
    return directory


@pytest.fixture(scope="module")
def coverage_text(covered: Path) -> str:
    """The words of the section on coverage, single spaces between them."""
    sections = r'<details class="fold" id="coverage">.*?</details>\s*<details class="fold"'
    (section,) = re.findall(sections, text_of(covered), re.DOTALL)
    return " ".join(Page(section.replace("<t", " <t")).text.split())


def test_coverage_of_a_family_is_in_the_report_with_its_design(coverage_text: str):
    assert "quiet 1,234 1,100 30 4 100 130 77 % 2-way: 104 of 9,000, at least 96" in coverage_text


def test_report_names_what_constraints_and_producers_took(coverage_text: str):
    assert "quiet: constraint see_<enough> excludes 1,100." in coverage_text
    assert "quiet: PathVariationRandom can't build 30;" in coverage_text


def test_report_shows_dimensions_and_pairs(coverage_text: str):
    assert "quiet system 2 2 of 3 67 % noise, radius" in coverage_text
    assert "quiet noise × radius 2 3 4 67 %" in coverage_text
    assert "Counted, not listed: 7 pairs." in coverage_text


def test_tags_of_a_report_with_coverage_are_closed_in_order(covered: Path):
    page = Page(text_of(covered))
    assert (page.open, page.misnested) == ([], [])


def test_directory_of_before_there_was_a_coverage_json_has_a_report_without_it(page: Page):
    assert "coverage" not in page.ids
    assert "#coverage" not in page.addresses


def test_report_shows_added_section_with_its_figure_and_table(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def battery(facts: Facts) -> Section:
        drawn = picture("battery", "Charge", "Charge of each run", "At the end.", Figure())
        table = Table([Column("Run"), Column("Charge (%)", "number")], [["noisy-1 <0>", 12]])
        return Section("battery", "Battery", "How full the battery was", "1 run", [soft("Of {}.", "A&B"), drawn, table])

    monkeypatch.setattr(report, "SECTIONS", (*report.SECTIONS, battery))
    write_report(directory)
    page = Page(text_of(directory))
    assert page.misnested == [] and "#battery" in page.addresses and "battery" in page.ids
    shown = " ".join(page.text[page.text.rindex("How full the battery was") :].split())
    assert shown.startswith(
        "How full the battery was1 run Of A&B. Charge At the end. PNG · SVG RunCharge (%) noisy-1 <0> 12"
    )
    assert (directory / "figures" / "battery.svg").is_file()
