"""The report and the evidence of a synthetic campaign directory, section by section."""

import base64
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from judged_directory import driven_by_nodes
from matplotlib.figure import Figure
from table import each_row

import vastflow
from vastflow.flows.results.summary import Results
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.findings import findings_of
from vastflow.oracles.figures.charts import interaction_figure
from vastflow.oracles.figures.maps import lines_plot
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.failures import cases, failure_kinds, kind_of
from vastflow.oracles.page.film import MOST_BYTES
from vastflow.oracles.page.headline import headline_html
from vastflow.oracles.page.report import write_lasting, write_report
from vastflow.oracles.page.search_section import CELLS_DRAWN, search_section
from vastflow.oracles.page.section import rate_cell, rate_html
from vastflow.oracles.page.sections import rejection_rows
from vastflow.oracles.page.words import number, percent, points, span
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.statistics.effects import Claim, InteractionEffect, LevelPair
from vastflow.oracles.statistics.intervals import Counts, Interval
from vastflow.sim.model.faults import UserError
from vastflow.sim.world.map_file import load_map

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
    passing = lost(build, 5, 0)
    early = {"outcome": "aborted", "reason": "no valid control"}
    mixed = passing[:3] + [build.a_recording(LINE[:20], run_index=i, **early) for i in (3, 4)]
    campaign, noisy = build.campaign(folder / "results"), {"oracles": oracles, "factors": {"noise": 0.1}}
    campaign.add("quiet-1", "quiet", room, TASK, recordings=passing, oracles=oracles, factors={"noise": 0.0})
    campaign.add("quiet-2", "quiet", room, TASK, oracles=oracles, fault="fault: MemoryError", runs=5)
    campaign.add("noisy-1", "noisy", room, TASK, recordings=mixed, **noisy)
    campaign.add("noisy-2", "noisy", room, TASK, recordings=passing, obstacles=[build.box_at(3.0, 2.4)], **noisy)
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


def written(campaign):
    """The text of the report of a campaign."""
    directory = campaign.write()
    write_report(directory)
    return text_of(directory)


@pytest.fixture(scope="module")
def page(shown: Path) -> Page:
    return Page(text_of(shown))


def words_of(directory):
    return " ".join(Page(text_of(directory)).text.split())


def rewritten(directory, **changes):
    """The words of the report after changes of `metadata.json`."""
    file = directory / "metadata.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    write_report(directory)
    return words_of(directory)


def test_page_is_well_formed_and_self_contained(page, shown):
    assert (page.misnested, page.open) == ([], [])
    kinds = ("image/png", "image/svg+xml", "video/mp4")
    inside = (*(f"data:{kind};base64," for kind in kinds), "#", "figures/")
    assert page.addresses and [address for address in page.addresses if not address.startswith(inside)] == []
    text = text_of(shown)
    assert not re.search(r"@import|url\(|<link|<script[^>]*src|fetch\(|XMLHttp|import\(", text)
    links = {address for address in page.addresses if address.startswith("figures/")}
    files = {f"figures/{file.name}" for file in (shown / "figures").iterdir()}
    assert links and links <= files
    assert {re.sub(r"-[0-9a-f]{8}$", "", Path(file).stem) for file in files} == {
        *("rates", "factors", "final-poses", "failure-rate", "failed", "passed", "case-noisy-1"),
        *("cause-too-close", "cause-no-path", "case-noisy-2", "film-noisy-2-0"),
    }
    assert text.count('href="figures/') == text.count('title="In the folder figures/ beside report.html"') > 0
    assert {address[1:] for address in page.addresses if address.startswith("#")} <= page.ids
    assert len(page.images) == 10  # rates, factors, four of the map, two configurations that failed, two causes
    assert all(image["alt"] for image in page.images)


def test_report_embeds_film_of_first_failure(shown):
    text, (film,) = text_of(shown), [*(shown / "figures").glob("*.mp4")]
    (video,) = re.findall(r"<video[^>]*>", text)
    assert "controls" in video and "autoplay" not in video and 'aria-label="Film of run 0 of noisy-2' in video
    (embedded,) = re.findall(r"data:video/mp4;base64,([^\"]*)", video)
    assert base64.b64decode(embedded) == film.read_bytes() and len(embedded) < MOST_BYTES
    assert f'href="figures/{film.name}"' in text


def test_report_has_same_film_again(directory):
    (film,) = (directory / "figures").glob("*.mp4")
    before, _ = film.read_bytes(), film.unlink()
    write_report(directory)
    assert film.read_bytes() == before


@each_row(
    ("name", "value"),
    [("oracles.page.film.MOST_BYTES", 1000), ("oracles.figures.film._encoder", lambda: "/bin/false")],
)
def test_report_omits_film_when_too_large_or_failed(directory, monkeypatch, name, value):
    monkeypatch.setattr(f"vastflow.{name}", value)
    shutil.rmtree(directory / "figures")
    write_report(directory)
    assert "<video" not in text_of(directory) and not [*(directory / "figures").glob("*.mp4")]


def test_report_takes_figures_of_same_content_and_draws_others(
    shown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = (Path(shutil.copytree(shown, tmp_path / name)) for name in ("one", "other"))
    shutil.rmtree(other / "figures")
    lasting = write_lasting(one)
    files = {path.relative_to(one): path.read_bytes() for path in one.rglob("*") if path.is_file()}
    assert "" not in lasting.drawn

    def before(key):
        found = [path for path in (one / "figures").iterdir() if path.stem == lasting.drawn.get(key)]
        return {path.suffix[1:]: path.read_bytes() for path in found} or None

    saved = []
    monkeypatch.setattr(Figure, "savefig", lambda *arguments, **named: saved.append(named))
    assert write_lasting(other, before) == lasting
    assert not saved
    assert files == {path.relative_to(other): path.read_bytes() for path in other.rglob("*") if path.is_file()}
    fewer = next(iter(lasting.drawn))
    write_lasting(other, lambda key: None if key == fewer else before(key))
    assert [named["format"] for named in saved] == ["png", "svg"]


def test_report_marks_facts_of_call(directory: Path) -> None:
    def rest() -> str:
        marks = r"<!-- when -->(.*?)<!-- /when -->|<!-- work -->(.*?)<!-- /work -->"
        parts = re.split(marks, text_of(directory), flags=re.DOTALL)
        assert "lab" in parts[5]
        return parts[0] + parts[3] + parts[6]

    first = rest()
    host = {"name": "lab 2", "memory_bytes": 25_276_502_016}
    counts = {"executed": 7, "reused": 8, "cpu_s": 9.0, "wall_s": 10.0, "results": "/elsewhere"}
    rewritten(directory, created="2027-01-01T00:00:00", host=host, counts=counts)
    assert rest() == first
    page = text_of(directory)
    assert "<dt>host memory</dt><dd>25.3 GB</dd>" in page and "<dt>CPU time</dt><dd>9 s</dd>" in page
    assert "<dt>runs</dt><dd>7 executed, 8 from the store</dd>" in page


def test_page_has_facts_of_campaign(page, shown):
    text = " ".join(page.text.split())
    said = (
        # quiet-1: 5 of 5; noisy-1: 3 of 5; noisy-2: 0 of 5, too close to the box.
        "8 of 15 judged runs passed every oracle. Intervals hold at 95 %.",
        "2 rejected requests, 1 duplicate, 5 runs not judged overall (5 by success, 5 by performance, 5 by safety), 1 fault, 1 note",
        *(REASON, "path_length 200; path_length 201", "fault: MemoryError", "noisy-3 is noisy-1"),
        *("execution.image: not executed by this version", "quiet, noisy", "The robot: mass 9 kg."),
        "Assumed: speed up to 0.5 m/s.",
    )
    assert [words for words in said if words not in text] == []
    assert text.index("vastflow replay . noisy-2 0") < text.index("vastflow replay . noisy-1 3")
    (data,) = re.findall(r'<script type="application/json" id="data-configurations">(.*?)</script>', text_of(shown))
    assert json.loads(data)["kinds"][:4] == ["text", "choice", "class", "rate"]
    assert [row[0] for row in json.loads(data)["rows"]] == ["noisy-2", "noisy-1", "quiet-1", "quiet-2"]
    assert json.loads(data)["rows"][1][3][:3] == [3, 5, 0]


def test_page_explains_choice_of_runs(directory):
    saved = rewritten(directory, sequential={"min": 3, "max": 20})
    assert "60 of 80 runs were saved" in saved and "the rates above count each configuration once" in saved
    asked = {"runs": 5, "sample": 4, "only": ["noisy*"]}
    chosen = rewritten(directory, counts={"sampled_from": 1234}, asked=asked)
    assert "A sample: 4 of 1,234 distinct configurations of the campaign" in chosen
    assert "Only this part of the campaign was requested: noisy*." in chosen


def test_evidence_has_rates_intervals_and_statistics(shown):
    evidence = json.loads((shown / "evidence.json").read_text())
    together = evidence["all_oracles"]
    assert list(evidence["oracles"]) == ["success", "performance", "safety"]
    assert [together["campaign"][key] for key in ("passed", "failed", "not_judged")] == [8, 7, 5]
    assert together["families"]["noisy"]["rate"] == pytest.approx(0.3)
    assert together["families"]["quiet"]["clustered"] is None
    quiet, broken = (together["configurations"][f"quiet-{k}"] for k in (1, 2))
    assert quiet["interval"] == pytest.approx({"low": 0.5655, "high": 1.0}, abs=1e-4)
    assert quiet["exact"] == pytest.approx({"low": 0.025 ** (1 / 5), "high": 1.0})
    assert (broken["exact"], broken["rate"]) == ({"low": 0.0, "high": 1.0}, None)
    assert evidence["oracles"]["success"]["families"]["noisy"]["passed"] == 8
    assert evidence["oracles"]["success"]["metrics"]["final_distance"]["n"] == 15
    assert (evidence["rejected"], evidence["duplicates"]) == (2, {"noisy-3": "noisy-1"})
    assert evidence["classes"]["configurations"]["noisy-2"] in ("systematic", "undecided")
    assert [evidence["total_failures"][key] for key in ("configurations", "failures", "of_failures")] == [1, 5, 7]
    (family,) = evidence["factors"][0]["factors"]  # which divides the configurations as noise does
    assert family["name"] == "family"
    found = evidence_of(read_tables(shown))[None].families["noisy"]
    assert (found.configurations, found.counts.judged) == (2, 10)


def test_bases_of_robustness_are_tabulated(synthetic_campaign, room, build):
    oracles = [("robustness", {"basis": "maximum"})]
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(LINE)], oracles=oracles)
    synthetic_campaign.metadata = {"oracles": [{"name": "robustness", "parameters": {"basis": "maximum"}}]}
    text = written(synthetic_campaign)
    assert "maximum, judged by" in text and "sum over meters driven" in text


def test_report_depends_on_directory_alone(shown, directory):
    before = {file.name: file.read_bytes() for file in (directory / "figures").iterdir()}
    shutil.rmtree(directory / "figures")
    with matplotlib.rc_context({"font.size": 30, "axes.facecolor": "black", "savefig.bbox": "tight"}):
        write_report(directory)
        assert matplotlib.rcParams["font.size"] == 30
    assert {file.name: file.read_bytes() for file in (directory / "figures").iterdir()} == before
    assert text_of(directory) == text_of(shown)


def test_campaigns_without_judged_runs_have_reports(synthetic_campaign, room, build):
    synthetic_campaign.reject("far", REASON, {"path_length": 200.0})
    page = Page(written(synthetic_campaign))
    assert "Nothing was run: no configuration could be built." in page.text
    assert REASON in page.text and page.misnested == []
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(LINE)])
    synthetic_campaign.verdicts = [{**row, "judgment": "not judged"} for row in synthetic_campaign.verdicts]
    written(synthetic_campaign)
    evidence = json.loads((synthetic_campaign.directory / "evidence.json").read_text())
    assert evidence["all_oracles"]["campaign"]["rate"] is None


@each_row(
    ("words", "value", "text"),
    [
        # A rate is never rounded to 0 or 100 %.
        *((percent, rate, text) for rate, text in ((None, "–"), (0.0, "0 %"), (1.0, "100 %"), (0.857, "86 %"))),
        *((percent, rate, text) for rate, text in ((0.9991, "99.9 %"), (0.0004, "0.04 %"))),
        # An interval is rounded outwards, with a decimal if it is narrow.
        (span, Interval(0.523, 0.704), "52–71 %"),
        (span, Interval(0.0, 1.0), "0–100 %"),
        (span, Interval(0.29, 0.57), "29–57 %"),
        (span, Interval(0.7601, 0.7649), "76.0–76.5 %"),
        *((points, value, text) for value, text in ((0.124, "+12"), (-0.5, "−50"), (-0.004, "+0"), (0.0, "+0"))),
        *((number, value, text) for value, text in ((None, "–"), (1e-15, "0"), (-1e-15, "0"))),
        *((number, value, text) for value, text in ((0.0582, "0.058"), (1234.5, "1,234"))),
    ],
)
def test_numbers_are_written_for_people(words, value, text):
    assert words(value).replace("\u00a0", " ").replace("\u2060", "") == text


@given(st.integers(0, 300), st.integers(0, 300))
@example(95, 25)  # 71.067 to 85.450 %: what is rounded to 85.5 first must not become 86 here and 85 there
def test_interval_is_same_in_headline_and_table_and_holds_computed_one(passed, failed):
    counts = Counts(passed, failed)
    if counts.judged:
        shown = span(counts.interval)
        assert f"<small>{shown}</small>" in rate_html(rate_cell(counts, (counts.rate, counts.interval)))
        low, high = (float(end) / 100 for end in shown.replace("\u2060", "").removesuffix("\u00a0%").split("–"))
        assert low <= counts.interval.low + 1e-8 and counts.interval.high - 1e-8 <= high


NOISE = {"combinations": 4, "admissible": 3, "covered": 2, "share": 2 / 3}
BOTH = {"factors": ["noise", "radius"], **NOISE}
COVERED = {
    "requested": 1234,
    "excluded": 1100,
    "unrealizable": 30,
    "duplicate": 4,
    "realized": 100,
    "valid": 130,
    "share": 100 / 130,
    "t_way": {"strength": 2, **NOISE, "pairs": [BOTH], "pairs_not_listed": 7},
}
QUIET = {
    **COVERED,
    "design": {"kind": "t_way", "strength": 2, "rows": 104, "product": 9000, "lower_bound": 96},
    "excluded_by": {"see_<enough>": 1100},
    "unrealizable_by": {"PathVariationRandom": {"count": 30, "reasons": {REASON: 30}, "reasons_not_listed": 0}},
    "dimensions": {"system": {**BOTH, "distinct": 2}},
}


def test_coverage_is_shown_by_family_dimension_and_pair(page, directory):
    assert "coverage" not in page.ids and "#coverage" not in page.addresses  # of an earlier version
    (directory / "coverage.json").write_text(json.dumps({**COVERED, "families": {"quiet": QUIET}}))
    write_report(directory)
    whole = Page(text_of(directory))
    assert (whole.open, whole.misnested) == ([], [])
    sections = r'<details class="fold" id="coverage">.*?</details>\s*<details class="fold"'
    (section,) = re.findall(sections, text_of(directory), re.DOTALL)
    text = " ".join(Page(section.replace("<t", " <t")).text.split())
    for words in (
        "quiet 1,234 1,100 30 4 100 130 77 % 2-way: 104 of 9,000, at least 96",
        "quiet: constraint see_<enough> excludes 1,100.",
        "quiet: PathVariationRandom can't build 30;",
        "quiet system 2 2 of 3 67 % noise, radius",
        "quiet noise × radius 2 3 4 67 %",
        "Counted, not listed: 7 pairs.",
    ):
        assert words in text


def lost(build, runs, failed, reason="no valid control"):
    """Recordings of `runs` runs, of which the first `failed` end early; the reason has the run's number for an `@`."""
    reasons = [reason.replace("@", str(i)) for i in range(failed)]
    early = [build.a_recording(LINE[:20], run_index=i, outcome="aborted", reason=r) for i, r in enumerate(reasons)]
    return early + [build.a_recording(LINE, run_index=i) for i in range(failed, runs)]


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


def test_designs_of_family_show_their_own_figures(synthetic_campaign, room, build):
    for k in range(16):
        factors = {"noise": (0.0, 0.1)[k % 2], "step": (1, 2)[k // 2 % 2]} | ({"late": k // 4 % 2} if k >= 8 else {})
        synthetic_campaign.add(f"a-{k + 1}", "a", room, TASK, recordings=lost(build, 3, 3 * (k % 2)), factors=factors)
    page = written(synthetic_campaign)
    section = page[page.index("All factors, with intervals") : page.index('<details class="fold"')]
    headings = [" ".join(heading.split()) for heading in re.findall(r"<h3>(.*?)</h3>", section, re.DOTALL)]
    assert headings == ["a, without late", "a, with late"]
    first, second = section.split("<h3>")[1:]
    assert (first.count("figures/factors-1.svg"), first.count("figures/factors-2.svg")) == (1, 0)
    assert (second.count("figures/factors-1.svg"), second.count("figures/factors-2.svg")) == (0, 1)


def test_few_failed_runs_are_no_finding_about_system(synthetic_campaign, room, build):
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=lost(build, 2, 0))
    assert "Why runs failed" not in written(synthetic_campaign)
    synthetic_campaign.add("a-2", "a", room, TASK, recordings=lost(build, 2, 2))
    page = written(synthetic_campaign)
    assert "Why runs failed" in page and "100\u00a0% of all failures" in page
    assert "not about chance" not in page


def test_interaction_figure_orders_numbers():
    levels = [("a", "1"), ("a", "10"), ("b", "1"), ("b", "2"), ("b", "10")]
    cells = tuple(LevelPair(pair, 1, 0.5, 0.5, Interval(0.0, 1.0)) for pair in levels)
    (axes,) = interaction_figure([InteractionEffect(("kind", "size"), cells, 0.0, Claim(None))]).axes
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1", "2", "10"]


def test_headline_shows_rate_causes_and_figures(synthetic_campaign, tmp_path, room, build):
    failed = build.a_recording(LINE[:20], run_index=1, outcome="aborted", error_xy_m=(0.0, 0.8))
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(LINE), failed])
    directory = synthetic_campaign.write()
    write_report(directory)
    html = Results(directory, None, (), ())._repr_html_()
    page = Page(html)
    assert (page.open, page.misnested) == ([], [])
    assert (
        "50 % passed; 9–91 % for this configuration" in page.text
        and "1 of 2 judged runs passed, 0 not judged" in page.text
    )
    assert "Lost" in page.text and "vastflow replay . a-1 1" in page.text
    assert [image["src"][:22] for image in page.images] == ["data:image/png;base64,"] * 2
    assert not re.search(r"<script|https?://", html)
    assert html == headline_html(directory)
    assert Results(tmp_path / "gone", None, (), ())._repr_html_() is None


def test_report_offers_no_replay_of_runs_that_nodes_drove(synthetic_campaign, room, build):
    failed = build.a_recording(LINE[:20], run_index=1, outcome="aborted", error_xy_m=(0.0, 0.8))
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(LINE), failed])
    directory = driven_by_nodes(synthetic_campaign.write())
    write_report(directory)
    text = Page(text_of(directory)).text
    assert "Nodes of ROS 2 drove the runs, which vastflow replay doesn't execute." in " ".join(text.split())
    assert "vastflow replay ." not in text and "bit for bit" not in text
    assert "vastflow replay" not in headline_html(directory)


def test_finished_directory_is_opened_with_summary_and_plot(synthetic_campaign, room, build, tmp_path):
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(LINE)])
    numbers = (
        "configurations",
        "rejected",
        "duplicates",
        "runs",
        "executed",
        "reused",
        "passed",
        "failed",
        "not_judged",
    )
    counts = {**dict.fromkeys((*numbers, "simulated_s", "cpu_s", "wall_s"), 1), "oracles": {"success": {"passed": 1}}}
    fault = {"configuration": "a-1", "run_index": None, "stage": "judge", "error": "MemoryError"}
    synthetic_campaign.metadata = {"counts": counts, "faults": [fault], "notes": ["a note"]}
    directory = synthetic_campaign.write()
    found = vastflow.open(str(directory))
    assert (found.directory, found.summary.passed, found.summary.oracles["success"]) == (directory, 1, Counts(1))
    assert (found.faults[0].error, found.notes, len(found.frame())) == ("MemoryError", ("a note",), 1)
    assert found.plot()._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(UserError, match="No such folder"):
        vastflow.open(tmp_path / "gone")
    (directory / "metadata.json").write_text('{"counts": 3, "faults": [], "notes": []}')
    with pytest.raises(UserError, match=str(directory)):
        vastflow.open(directory)


def test_lines_are_drawn_on_a_map_with_their_names(room):
    figure = lines_plot([("run 0", [1, 2], [1, 1])], "x (m)", "y (m)", load_map(room)).figure
    (axes,) = figure.axes
    assert [line.get_label() for line in axes.lines] == ["run 0"]
    assert axes.images and axes.get_xlim()[1] > 6.0


COUNT = CELLS_DRAWN + 2
SEARCH = {
    "strategy": "qd",
    "space": {},
    "objective": "failure_rate",
    "is_rate": True,
    "direction": "maximize",
    "batches": 1,
    "proposals": COUNT,
    "rejected": 0,
    "runs": COUNT,
    "ended_by": "runs",
    "confirmation": None,
}


def test_search_section_draws_runs_of_worst_cells(synthetic_campaign, room, build):
    for k in range(COUNT):
        obstacles = [build.box_at(3.0, 1.5 + 0.2 * k)]
        recordings = [build.a_recording(LINE)]
        synthetic_campaign.add(f"point-{k}", "search", room, TASK, recordings=recordings, obstacles=obstacles)
    archive = {"measures": {name: {"low": 0, "high": 10} for name in "xy"}}
    best = {"configuration": "point-3", "point": {}, "objective": 1.0, "runs": 1}
    synthetic_campaign.metadata = {"search": {**SEARCH, "parameters": {"archive": archive}, "best": best}}
    directory = synthetic_campaign.write()
    objectives = [0.1, 0.5, 0.2, 1.0, 0.3, 0.4]
    evaluations = [{"configuration": f"point-{k}", "objective": objectives[k], "runs": 1} for k in range(COUNT)]
    pq.write_table(pa.Table.from_pylist(evaluations), directory / "evaluations.parquet")
    cells = [
        {**each, "cell": json.dumps([k, 0]), "measures": json.dumps({"x": k + 0.5, "y": 0.0})}
        for k, each in enumerate(evaluations)
    ]
    pq.write_table(pa.Table.from_pylist(cells), directory / "archive.parquet")
    drawn = search_section(Facts(read_tables(directory))).pictures
    worst = [f"cell-point-{k}" for k in (3, 1, 5, 4)]
    assert [each.name for each in drawn] == ["search-progress", "search-archive", *worst]
    assert (drawn[2].title, drawn[2].caption) == ("point-3: failure rate 1", "The best point at x 3.5, y 0.")


def test_report_of_search_claims_no_factors(synthetic_campaign, room, build):
    for k in range(12):
        task = {**TASK, "goal_pose": {"x": 5.0, "y": 2.0 + 0.01 * k}}
        runs = lost(build, 6, 5 * (k % 2))
        synthetic_campaign.add(f"point-{k}", "search", room, task, recordings=runs, factors={"noise": k % 2})
    assert "noise matters" in written(synthetic_campaign)
    synthetic_campaign.metadata = {"search": {**SEARCH, "parameters": {}, "best": None}}
    empty = pa.table({"configuration": pa.array([], pa.string())})
    pq.write_table(empty, synthetic_campaign.directory / "evaluations.parquet")
    page = written(synthetic_campaign)
    assert "noise matters" not in page and "account for" not in page
    assert json.loads((synthetic_campaign.directory / "evidence.json").read_text())["factors"] == []


def test_cases_order_configurations_by_lower_bounds(synthetic_campaign, room, build):
    for name, failed, runs in (("one-of-one", 1, 1), ("nine-of-ten", 9, 10)):
        task = {**TASK, "goal_pose": {"x": 5.0, "y": 2.0 + 0.1 * runs}}
        synthetic_campaign.add(name, "search", room, task, recordings=lost(build, runs, failed))
    tables = read_tables(synthetic_campaign.write())
    assert [tables.configurations.names[k] for k in cases(tables, findings_of(tables))] == ["nine-of-ten", "one-of-one"]
