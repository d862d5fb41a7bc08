"""The list of campaigns: order, states, rates, changes of the file, and trends."""

import json
import re
import shutil
from datetime import datetime

import pytest
from table import each_row

from vastflow.deployments.explorer.campaigns_page import counts_of, rows_of, trends_of
from vastflow.deployments.explorer.directories import Directories, NoSuchCampaign
from vastflow.deployments.explorer.file_change import MOST_LINES, file_change
from vastflow.oracles.results.events import EVENTS, Event
from vastflow.oracles.results.unfinished import WRITER, writer
from vastflow.oracles.statistics.intervals import Counts

TEXT = "version: 1\nexecution:\n  runs: 4\n"


@pytest.fixture
def directories(results):
    return Directories([results])


def rows(directories):
    return list(rows_of(directories.all(), file_change))


def test_directories_are_found_below_folders_newest_first(directories, add_campaign, results):
    add_campaign(20, {"room": [1]})
    add_campaign(22, {"room": [1]}, name="deep")
    (results / "a" / "b").mkdir(parents=True)
    shutil.move(results / "deep-2026-11-22-060000", results / "a" / "b")
    assert [each.name for each in directories.all()] == ["deep", "office"]


def test_directories_take_campaign_directory_itself(add_campaign):
    directory = add_campaign(20, {"room": [1]})
    assert [each.path for each in Directories([directory, directory.parent]).all()] == [directory]


def test_directories_keep_ids_and_tell_equal_names_apart(directories, add_campaign, results):
    first = add_campaign(20, {"room": [1]})
    (results / "other").mkdir()
    shutil.copytree(first, results / "other" / first.name)
    ids = {each.id for each in directories.all()}
    assert len(ids) == 2 and ids == {each.id for each in Directories([results]).all()}
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+", id) for id in ids)


def test_directories_find_known_ids_and_refuse_others(directories, add_campaign):
    path = add_campaign(20, {"room": [1]})
    (id,) = [each.id for each in directories.all()]
    assert directories.find(id).path == path
    shutil.rmtree(path)
    with pytest.raises(NoSuchCampaign, match="moved or removed"):
        directories.find(id)


@each_row(
    ("content", "words"),
    [
        (b"", "metadata.json"),
        (b"{", "metadata.json"),
        (b"[]", "metadata.json has no counts"),
        (b'{"name": "office", "created": "2026-11-20T06:00:00"}', "has no counts"),
        (b'{"name": "office", "created": "2026-11-20T06:00:00", "counts": []}', "has no counts"),
        (b"\xff\xfe", "metadata.json"),
    ],
)
def test_half_written_directory_is_damaged(directories, add_campaign, content, words):
    path = add_campaign(20, {"room": [1]})
    (path / "metadata.json").write_bytes(content)
    (found,) = directories.all()
    assert (found.state, words in found.problem) == ("damaged", True)


def test_list_shows_damage_beside_whole_campaigns(client, add_campaign):
    add_campaign(20, {"room": [1]})
    (add_campaign(21, {"room": [1]}) / "metadata.json").write_text("{")
    page = client.get("/").text
    assert page.count("<tr>") == 3 and "damaged" in page and "75.0 %" in page


def test_empty_list_names_searched_folders(client, results):
    page = client.get("/").text
    assert "No campaign directory below" in page and str(results) in page


def test_rates_have_wilson_intervals_rounded_outwards(client, add_campaign):
    add_campaign(20, {"room": [1, 1]})
    page = client.get("/").text
    assert "75.0 %" in page and "40.9–92.9" in page


@each_row("counts", [{}, {"passed": 1}, {"passed": "1", "failed": 0, "not_judged": 0}, {"passed": -1}])
def test_unknown_counts_are_not_measured(client, add_campaign, counts):
    path = add_campaign(20, {"room": [1]})
    metadata = json.loads((path / "metadata.json").read_text())
    (path / "metadata.json").write_text(json.dumps(metadata | {"counts": counts}))
    page = client.get("/").text
    assert "not measured" in page and "0.0 %" not in page


def test_list_survives_values_of_any_kind(client, add_campaign):
    path = add_campaign(20, {"room": [1]})
    metadata = json.loads((path / "metadata.json").read_text())
    odd = {
        "name": "\ud800 <b>",
        "created": [1],
        "faults": "none",
        "counts": {"runs": "x", "configurations": [], "passed": 1e9},
    }
    (path / "metadata.json").write_text(json.dumps(metadata | odd))
    add_campaign(21, {"room": [1]})
    page = client.get("/")
    assert page.status_code == 200 and "? &lt;b&gt;" in page.text and "not measured" in page.text


def test_change_compares_with_previous_campaign_of_the_name(directories, add_campaign):
    add_campaign(20, {"room": [1]}, text=TEXT)
    add_campaign(21, {"room": [1]}, text="other", name="other")
    add_campaign(22, {"room": [1]}, text=TEXT.replace("4", "8") + "  seed: 1\n")
    newest, other, first = rows(directories)
    assert (first.change, other.change) == (None, None)
    assert (newest.change.added, newest.change.removed, newest.change.previous) == (2, 1, first.campaign)
    assert [line for line in newest.change.lines if line[0] == "+"] == ["+  runs: 8", "+  seed: 1"]
    assert newest.change.lines[0].startswith("@@ -1")


def test_change_counts_omitted_lines(directories, add_campaign):
    add_campaign(20, {"room": [1]}, text="a\n")
    add_campaign(21, {"room": [1]}, text="b\n" * (MOST_LINES + 50))
    change = rows(directories)[0].change
    assert (change.added, len(change.lines), change.left_out) == (MOST_LINES + 50, MOST_LINES, 52)


def test_change_reports_deleted_file(directories, add_campaign):
    (add_campaign(20, {"room": [1]}) / "campaign.vast").unlink()
    add_campaign(21, {"room": [1]})
    change = rows(directories)[0].change
    assert change.lines == () and "campaign.vast" in change.others[0]


def test_trend_has_judged_campaigns_of_a_name_oldest_first(directories, add_campaign):
    for day, lost in ((20, 1), (21, 2), (22, 0)):
        add_campaign(day, {"room": [lost]})
    add_campaign(23, {"room": [1]}, name="single")
    (trend,) = trends_of(rows(directories))
    assert [row.counts for row in trend["campaigns"]] == [Counts(3, 1), Counts(2, 2), Counts(4, 0)]


def test_trends_part_files_and_robots_of_one_name(client, directories, add_campaign):
    for day, file, robot in ((20, "a", "x"), (21, "a", "x"), (22, "b", "x"), (23, "b", "x"), (24, "b", "y")):
        metadata = add_campaign(day, {"room": [1]}) / "metadata.json"
        told = {"asked": {"file": f"{file}.vast"}, "robots": [{"families": ["room"], "summary": robot, "robot": []}]}
        metadata.write_text(json.dumps(json.loads(metadata.read_text()) | told))
    found = [(each["of"], len(each["campaigns"])) for each in trends_of(rows(directories))]
    assert found == [("b.vast, x", 2), ("a.vast, x", 2)]
    page = client.get("/").text
    assert page.count("Rate of office over 2 campaigns") == 2
    assert re.findall(r">([ab]\.vast, x)<", page) == ["b.vast, x", "a.vast, x"]


def test_running_campaign_has_counts_in_the_list(client, results):
    place = results / ".office-2026-11-21-060000.running"
    place.mkdir()
    (place / WRITER).write_text(json.dumps(writer()))
    counts = {"runs_done": 1234, "runs_total": 3685, "passed": 1000, "failed": 234, "not_judged": 0}
    now = datetime.now().astimezone()
    events = [Event(now, "began", {"name": "office"}), Event(now, "progress", counts)]
    for later in ([], [Event(now, "verdicts", {"runs": [1]})], [Event(now, "progress", {"runs_done": "many"})]):
        (place / EVENTS).write_bytes(b"".join(each.line for each in [*events, *later]))
        page = client.get("/").text
        is_whole = not later or later[0].event == "verdicts"
        assert ("1,234 of 3,685" in page and "1,000 passed, 234 failed so far" in page) == is_whole


def test_trend_is_drawn_from_left_to_right_with_intervals(client, add_campaign):
    for day, lost in ((20, 1), (21, 2), (22, 0)):
        add_campaign(day, {"room": [lost]})
    pattern = r'y="([\d.]+)" height="([\d.]+)"/><circle class="pass" cx="([\d.]+)" cy="([\d.]+)"'
    drawn = [tuple(map(float, each)) for each in re.findall(pattern, client.get("/").text)]
    assert [x for _, _, x, _ in drawn] == [42.0, 147.0, 252.0]
    assert all(8 <= high <= at <= high + height + 0.1 <= 56.1 for high, height, _, at in drawn)
    first, second, third = (at for *_, at in drawn)
    assert third < first < second


def test_list_of_one_name_has_an_address(client, add_campaign):
    add_campaign(20, {"room": [1]})
    add_campaign(21, {"room": [1]}, name="a&b")
    page = client.get("/", params={"name": "a&b"}).text
    assert page.count("<tr>") == 2 and "a&amp;b" in page and ">office<" not in page


@each_row("days", [(20, 21), (21, 20)])
def test_ticked_campaigns_are_compared_older_first(client, add_campaign, id_of, days):
    paths = {day: add_campaign(day, {"room": [1]}, name=f"order-{days[0]}") for day in days}
    reply = client.get("/chosen", params={"c": [id_of(paths[day]) for day in days]})
    assert (reply.status_code, reply.headers["location"]) == (
        303,
        f"/compare?a={id_of(paths[20])}&b={id_of(paths[21])}",
    )


def test_ticked_campaigns_must_be_two(client):
    assert "Expected two ticked campaigns, got 0." in client.get("/chosen").text


def test_counts_of_running_campaign_are_unknown(directories, results):
    (results / ".office-2026-11-20-060000.partial").mkdir()
    (found,) = directories.all()
    assert (found.state, found.created, counts_of(found)) == ("stopped", "2026-11-20T06:00:00", None)
