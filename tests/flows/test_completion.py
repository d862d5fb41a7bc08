"""Names that the Tab key completes, asked as bash asks."""

import os
import subprocess
import sys

import pytest
from table import each_row

MAIN = "import sys; sys.argv = ['vastflow']; from vastflow.flows.cli.__main__ import main; main()"


def completed(folder, line):
    """Return the words for the last word of a command line, which may be empty."""
    words = line.split(" ")
    asked = {"_VASTFLOW_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-c", MAIN],
        cwd=folder,
        env={**os.environ, **asked},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.fixture
def place(ran, small_room):
    """A folder with the directory of a finished campaign, whose file names plug-ins that nobody may execute."""
    folder = ran().parents[1]
    (small_room.parent / "own.py").write_text("raise SystemExit('executed')")
    text = small_room.read_text().replace("    variations:\n", "    variations:\n      - own.py:Own: {}\n")
    small_room.write_text(text + "evaluation: {oracles: [own.py:Own]}\n")
    return folder


@each_row(
    ("line", "words"),
    [
        ("run campaign/room.vast --only ", ["room", "room-1", "room-2"]),
        ("plan campaign/room.vast --runs 3 --only room --only room-", ["room-1", "room-2"]),
        ("run campaign/room.vast --results elsewhere --only ", ["room"]),
        ("plan results/DIRECTORY --only room-2", ["room-2"]),
        ("run missing.vast --only ", []),
        ("show results/DIRECTORY ", ["room-1", "room-2"]),
        ("show results/DIRECTORY room-2", ["room-2/0", "room-2/1"]),
        ("show results/DIRECTORY room-2/1", ["room-2/1"]),
        ("show results ", []),
        ("export results/DIRECTORY out --only ", ["room-1", "room-2"]),
    ],
)
def test_tab_key_completes_names_and_executes_no_plug_in(place, line, words):
    (directory,) = (place / "results").iterdir()
    assert completed(place, f"vastflow {line.replace('DIRECTORY', directory.name)}") == words
