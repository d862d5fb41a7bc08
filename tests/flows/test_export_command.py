"""`vastflow export`: what it says, and what it refuses."""

import re
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.flows.cli import export as export_command
from vastflow.flows.export import export as layout
from vastflow.flows.export.export import Exported, refuse
from vastflow.flows.export.junit import Case, Flaw, Suite
from vastflow.sim.model.faults import UserError

FAILURE, ERROR, SKIPPED = Flaw("failure", "f"), Flaw("error", "e"), Flaw("skipped", "s")


def called(*arguments):
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


@pytest.fixture
def results(tmp_path):
    """What is taken for a campaign directory until it is read."""
    (tmp_path / "results").mkdir()
    (tmp_path / "results/metadata.json").write_text("{}")
    return tmp_path / "results"


def exporting(monkeypatch, *flaws, duplicates=0):
    """Put one configuration of runs with these flaws in the export's place; what it was asked for."""
    asked = []

    def export(results, folder, only, progress):
        asked.append((results, folder, tuple(only)))
        return Exported(folder, duplicates, [Suite("room", [Case("r", "c", 1.0, flaw=flaw) for flaw in flaws])])

    monkeypatch.setattr(layout, "export", export)
    return asked


def test_it_says_what_became_of_the_runs_and_where_they_are(results, monkeypatch):
    asked = exporting(monkeypatch, None, None, FAILURE)
    done = called(results, "out", "--only", "room*", "--only", "hall")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == "1 configuration; 3 runs: 2 passed, 1 failed\nexported: out\n"
    assert asked == [(results, Path("out"), ("room*", "hall"))]


def test_it_says_what_nobody_judged_and_what_was_not_run_twice(results, monkeypatch):
    exporting(monkeypatch, None, ERROR, SKIPPED, SKIPPED, duplicates=2)
    assert called(results, "out").stdout.splitlines()[0] == (
        "3 configurations, 2 of the content of another; 4 runs: 1 passed, 0 failed, 1 broken, 2 not judged"
    )


def test_failed_runs_are_no_fault_of_the_export(results, monkeypatch):
    exporting(monkeypatch, FAILURE, ERROR)
    assert called(results, "out").exit_code == 0


def test_progress_is_said_now_and_then(results, monkeypatch):
    monkeypatch.setattr(export_command, "PERIOD_S", 0.0)

    def export(results, folder, only, progress):
        progress(7, 30)
        return Exported(folder, 0, [])

    monkeypatch.setattr(layout, "export", export)
    assert called(results, "out").stderr == "7 of 30 configurations exported\n"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda tmp_path: [tmp_path / "nowhere", tmp_path / "out"], r"nowhere: no such folder; a folder that"),
        (lambda tmp_path: [tmp_path, tmp_path / "out"], r"holds 1 campaign directories; name one of them"),
        (lambda tmp_path: [tmp_path / "results", tmp_path / "results"], r"the folder is not empty; a new one, or"),
        (
            lambda tmp_path: [tmp_path / "results", tmp_path / "results/metadata.json"],
            r"metadata.json: not a folder; a new one, or an empty one",
        ),
        (lambda tmp_path: [tmp_path / "results", tmp_path / "out"], r"results: damaged campaign directory: "),
    ],
)
def test_what_is_wrong_is_said_in_one_line_and_nothing_is_written(results, tmp_path, wrong, words):
    done = called(*wrong(tmp_path))
    assert (done.exit_code, done.stdout) == (2, "")
    assert re.search(words, done.stderr) and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_folder_that_cant_be_made_is_said_in_one_line(results, tmp_path, monkeypatch):
    def export(results, folder, only, progress):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(layout, "export", export)
    done = called(results, tmp_path / "out")
    assert done.exit_code == 2
    assert done.stderr == f"{tmp_path / 'out'}: can't be written (Permission denied); name another folder\n"


def test_new_folder_and_an_empty_one_are_good(tmp_path):
    refuse(tmp_path / "new")
    refuse(tmp_path)


def test_link_that_leads_nowhere_is_refused(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    with pytest.raises(UserError, match=r"link: not a folder"):
        refuse(tmp_path / "link")


def test_page_about_exports_describes_every_option():
    page = (Path(__file__).parents[2] / "docs" / "export-results.md").read_text()
    described = set(re.findall(r"^\| `(--[a-z]+)", page, re.MULTILINE))
    options = {name for option in get_command(app).commands["export"].params for name in option.opts if "--" in name}
    assert described == options - {"--help"}
