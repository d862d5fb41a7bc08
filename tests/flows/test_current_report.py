"""Current reports: a repeated command names the existing directory, any change makes a new one."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from bench_pipeline import SCENARIO, campaign_text

from vastflow.flows import run_campaign
from vastflow.flows.results.current_report import newest_sealed, seal
from vastflow.flows.results.kept_report import MOST_KEPT, copy_report, keep_report
from vastflow.oracles.page.report import write_report

pytestmark = pytest.mark.timeout(900)


def same_size_and_time(file: Path, old: str, new: str) -> None:
    """Edit a file so that neither its size nor the time of its last change tells of it."""
    before = file.stat()
    text = file.read_text()
    assert old in text and len(old) == len(new)
    file.write_text(text.replace(old, new))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.fixture
def sealed(tmp_path):
    directory = tmp_path / "a-2026-01-31-120000"
    (directory / "figures").mkdir(parents=True)
    (directory / "metadata.json").write_text('{"report": "key"}')
    (directory / "report.html").write_text("<p>7 of 8</p>")
    (directory / "figures" / "rates.png").write_bytes(b"picture")
    seal(directory)
    return directory


DAMAGE = {
    "a figure is gone": lambda directory: (directory / "figures" / "rates.png").unlink(),
    "a report was edited": lambda directory: same_size_and_time(directory / "report.html", "7 of 8", "8 of 8"),
    "a file is empty": lambda directory: (directory / "metadata.json").write_text(""),
    "the note is damaged": lambda directory: (directory / ".files.json").write_text("[]"),
    "the directory is gone": shutil.rmtree,
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_directory_is_not_current(sealed, damage):
    assert newest_sealed(sealed.parent, "a", "key") == sealed
    damage(sealed)
    assert newest_sealed(sealed.parent, "a", "key") is None


def test_current_directory_is_newest_of_same_name_moved_or_extended(sealed, tmp_path):
    (sealed / "notes.txt").write_text("mine")
    (tmp_path / "elsewhere").mkdir()
    sealed = sealed.rename(tmp_path / "elsewhere" / sealed.name)
    (sealed.parent / "a-b-2027-01-31-120000").mkdir()
    assert newest_sealed(sealed.parent, "a", "key") == sealed
    (sealed.parent / "a-2026-01-31-120000-2").mkdir()
    assert newest_sealed(sealed.parent, "a", "key") is None


def files(directory):
    found = (path for path in directory.rglob("*") if path.is_file())
    return {path.relative_to(directory).as_posix(): path.read_bytes() for path in found}


@pytest.fixture(scope="module")
def computed(tmp_path_factory, prefect_home):
    """A folder with a campaign, and what a run of it came to; all of it is in the store."""
    folder = tmp_path_factory.mktemp("nothing")
    (folder / "nothing.osc").write_text(SCENARIO)
    (folder / "nothing.vast").write_text(campaign_text(3, 2, edited=0))
    (folder / "work").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PREFECT_HOME", str(prefect_home(folder / "prefect")))
        patch.delenv("PREFECT_API_URL", raising=False)
        first = run_campaign(folder / "nothing.vast", results=folder / "results", store=folder / "store", workers=1)
    return folder, first


HEAVY = "{'prefect', 'numba', 'scipy', 'matplotlib', 'pandas', 'jinja2', 'pymunk'}"


def command(folder, *arguments):
    """The JSON that the command line prints in a folder, and which heavy modules it loads for that."""
    asked = ["run", folder / "nothing.vast", "--store", folder / "store", "--json", *arguments]
    script = (
        f"import sys; sys.argv = ['vastflow', *{[str(each) for each in asked]!r}]\n"
        "from vastflow.flows.cli.__main__ import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code, end.code\n"
        f"print(*{HEAVY} & sys.modules.keys())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=folder / "work", capture_output=True, text=True, timeout=300, check=True
    )
    said, loaded = done.stdout.splitlines()
    return json.loads(said), loaded.split()


def test_repeated_command_names_existing_directory(computed):
    folder, first = computed
    again, loaded = command(folder, "--results", folder / "results")
    assert (again["executed"], again["reused"], again["results"]) == (0, 6, str(first.directory))
    made = first.summary.as_json()
    of_a_call = {"executed", "reused", "simulated_s", "cpu_s", "wall_s"}
    assert {name: made[name] for name in made.keys() - of_a_call} == {
        name: again[name] for name in again.keys() - of_a_call
    }
    assert loaded == []


def test_deleted_report_is_rebuilt_from_store_without_prefect(computed):
    folder, first = computed
    made, loaded = command(folder, "--results", folder / "other")
    before, after = files(first.directory), files(Path(made["results"]))
    assert before.keys() - {"logs/campaign.log"} == after.keys()
    different = {name for name in after if before[name] != after[name]}
    assert different == {"events.jsonl", "metadata.json", "report.html", ".files.json"}
    assert "prefect" not in loaded
    (Path(made["results"]) / "report.html").unlink()
    assert command(folder, "--results", folder / "other")[0]["results"] != made["results"]


def test_changed_input_does_not_reuse_existing_directory(computed):
    folder, _ = computed
    results = ("--results", folder / "edited")
    before, _ = command(folder, *results)
    same_size_and_time(folder / "nothing.vast", "name: nothing", "name: nothin9")
    same_size_and_time(folder / "nothing.vast", "name: nothin9", "name: nothing")
    assert command(folder, *results)[0]["results"] == before["results"]
    with (folder / "nothing.osc").open("a") as scenario:
        scenario.write("# a comment\n")
    after, _ = command(folder, *results)
    assert after["executed"] == 0 and after["results"] != before["results"]
    assert b"# a comment" in files(Path(after["results"]))["inputs/nothing.osc"]
    fewer, _ = command(folder, *results, "--runs", "1")
    assert fewer["runs"] == 3 and fewer["results"] != after["results"]


def edited(folder, old, new):
    file = folder / "nothing.vast"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def test_comment_in_campaign_file_copies_report_and_draws_nothing(computed, tmp_path):
    folder, _ = computed
    results = ("--results", tmp_path / "results")
    before = Path(command(folder, *results)[0]["results"])
    edited(folder, "version: 1", "version: 1  # <b>why</b> <!-- work --><!-- /work -->")
    made, loaded = command(folder, *results)
    after = Path(made["results"])
    assert after != before and not {"prefect", "matplotlib", "scipy"} & {*loaded}
    page = (after / "report.html").read_text()
    assert "# &lt;b&gt;why&lt;/b&gt; &lt;!-- work --&gt;" in page and "<!-- file -->" not in page
    assert after.name.removeprefix("nothing-")[:10] in page.partition("<!-- when -->")[2][:20]
    one, other = files(before), files(after)
    different = {name for name in one.keys() | other.keys() if one.get(name) != other.get(name)}
    assert different == {"campaign.vast", "events.jsonl", "metadata.json", "report.html", ".files.json"}
    write_report(after)
    for mark in ("<!-- work -->", "<!-- /work -->"):
        assert page.count(mark) == 1
    assert page.partition("<!-- work -->")[0] == (after / "report.html").read_text().partition("<!-- work -->")[0]
    assert files(after)["evidence.json"] == other["evidence.json"]


@pytest.mark.parametrize(
    ("old", "new", "options"),
    [("{name: nothing}", "{name: nothing, title: Another name}", ()), ("version: 1", "version: 1", ("--runs", "1"))],
    ids=["title", "runs"],
)
def test_report_of_other_content_is_not_copied(computed, tmp_path, old, new, options):
    folder, _ = computed
    before = command(folder, "--results", tmp_path / "results")[0]["results"]
    edited(folder, old, new)
    made, loaded = command(folder, "--results", tmp_path / "results", *options)
    assert "matplotlib" in loaded and made["results"] != before
    page = (Path(made["results"]) / "report.html").read_text()
    assert "Another name" in page or options
    assert f"of {3 if options else 6} judged runs passed" in " ".join(page.split())


def test_damaged_copy_of_report_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: str(tmp_path / name))
    directory = tmp_path / "one"
    (directory / "figures").mkdir(parents=True)
    for name in ("evidence.json", "report.html", "runs_wide.parquet", "figures/rates.png"):
        (directory / name).write_text(name)
    keep_report(directory, "key", "code", {"text": "7 of 8"}, {})
    (tmp_path / "two").mkdir()
    assert copy_report(tmp_path / "two", "key") == {"text": "7 of 8"}
    assert files(tmp_path / "two") == files(directory)
    (kept,) = (tmp_path / "vastflow" / "reports").iterdir()
    kept.write_bytes(kept.read_bytes()[:-40])
    assert copy_report(tmp_path / "two", "key") is None and copy_report(tmp_path / "two", "other") is None


def test_kept_reports_are_the_newest(tmp_path, monkeypatch):
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: str(tmp_path / name))
    for name in ("evidence.json", "report.html", "runs_wide.parquet"):
        (tmp_path / name).write_text(name)
    (tmp_path / "figures").mkdir()
    reports = tmp_path / "vastflow" / "reports"
    for number in range(MOST_KEPT + 2):
        keep_report(tmp_path, f"key-{number}", "code", {}, {})
        os.utime(reports / f"key-{number}.zip", (number, number))
    assert not {"key-0.zip", "key-1.zip"} & {each.name for each in reports.iterdir()}
    assert len([*reports.iterdir()]) == MOST_KEPT
