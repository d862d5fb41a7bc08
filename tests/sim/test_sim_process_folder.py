import re

import pytest
from table import each_row

from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.programs.folders import copy_in, files_matching, unmatched

TREE = (
    "run.py",
    "notes.txt",
    ".hidden",
    "files/a.py",
    "files/b.yaml",
    "files/deep/er/c.py",
    "files/.git/config",
    "files/__pycache__/a.pyc",
)


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "campaign"
    for name in TREE:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    return folder


@each_row(
    ("pattern", "expected"),
    [
        ("run.py", ["run.py"]),
        ("*.py", ["files/a.py", "files/deep/er/c.py", "run.py"]),
        ("c.py", ["files/deep/er/c.py"]),
        ("files/*.py", ["files/a.py"]),
        ("./files/*.py", ["files/a.py"]),
        ("files/**", ["files/a.py", "files/b.yaml", "files/deep/er/c.py"]),
        ("files/**/*.py", ["files/a.py", "files/deep/er/c.py"]),
        ("**", ["files/a.py", "files/b.yaml", "files/deep/er/c.py", "notes.txt", "run.py"]),
        ("**/[ab].*", ["files/a.py", "files/b.yaml"]),
        ("**/[!ab].py", ["files/deep/er/c.py"]),
        ("files/?.yaml", ["files/b.yaml"]),
        ("files/**/deep/**/c.*", ["files/deep/er/c.py"]),
        ("[z-a]", []),
        (".hidden", [".hidden"]),
        ("files/.git/*", ["files/.git/config"]),
        ("nothing/*", []),
    ],
)
def test_pattern_names_these_files(campaign, pattern, expected):
    assert [path for path, _ in files_matching(campaign, [pattern])] == expected


def test_files_come_once_in_the_order_of_their_paths_with_their_digests(campaign):
    found = files_matching(campaign, ["run.py", "*.py", "notes.txt"])
    assert [path for path, _ in found] == ["files/a.py", "files/deep/er/c.py", "notes.txt", "run.py"]
    assert all(content.digest == file_digest(campaign / path) for path, content in found)


def test_patterns_without_a_file_are_told_and_folders_are_left_out(campaign):
    patterns = ["run.py", "rnu.py", "files/**"]
    assert unmatched(files_matching(campaign, patterns), patterns) == ("rnu.py",)
    found = files_matching(campaign, ["*.py"], lambda folder: folder.name == "deep")
    assert [path for path, _ in found] == ["files/a.py", "run.py"]


@each_row("pattern", ["/etc/passwd", "../secret", "files/../../secret", ""])
def test_pattern_that_leaves_the_folder_is_refused(campaign, pattern):
    with pytest.raises(ScenarioError, match=rf"expected .*, got run_files pattern '{re.escape(pattern)}'"):
        files_matching(campaign, [pattern])


def test_copies_hold_the_same_and_are_executable_where_their_originals_are(campaign, tmp_path):
    (campaign / "run.py").chmod(0o555)
    files = files_matching(campaign, ["*.py"])
    copy_in(files, tmp_path / "copy")
    copies = sorted(path for path in (tmp_path / "copy").rglob("*") if path.is_file())
    assert [path.relative_to(tmp_path / "copy").as_posix() for path in copies] == [path for path, _ in files]
    assert (tmp_path / "copy/run.py").stat().st_mode & 0o777 == 0o755


def test_file_that_changed_or_is_gone_is_not_copied(campaign, tmp_path):
    files = files_matching(campaign, ["run.py"])
    (campaign / "run.py").write_text("something else")
    with pytest.raises(ScenarioError, match=r"run\.py' changed since the campaign was read"):
        copy_in(files, tmp_path / "copy")
    (campaign / "run.py").unlink()
    with pytest.raises(ScenarioError, match=r"run\.py' can't be copied: No such file"):
        copy_in(files, tmp_path / "copy")
