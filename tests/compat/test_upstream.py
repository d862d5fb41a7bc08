"""RoboVAST's own configurations still run.

They are the `configs` of a clone of RoboVAST, where `$ROBOVAST_CONFIGS` names that folder, or else those that lie beside the
repository: data alone, without the programs that some of them start. What lacks a program is skipped.

`expected.json` has for each file what `table.py` said of it with two configurations of a campaign and one run of each, and the programs
beside it that this takes. A row that is better than that fails nothing; one that got worse does.
"""

import json
import shutil
import sys
from pathlib import Path

import pytest
from outside import CONFIGS, NO_CONFIGS, ROBOVAST

EXPECTED = json.loads((Path(__file__).parent / "expected.json").read_text())
RANKS = ("refused", "valid", "ran")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(2400)]  # the first of them executes all files


def missing_programs(file):
    folder = (CONFIGS / file).parent
    return [program for program in EXPECTED[file].get("programs", ()) if not (folder / program).is_file()]


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    if not ROBOVAST and not CONFIGS.is_dir():
        pytest.skip(f"RoboVAST's configurations are not here: {NO_CONFIGS}")
    sys.path.insert(0, str(Path(__file__).parent))
    try:
        from rows import Trial, rows_of
    finally:
        sys.path.pop(0)
    folder = shutil.copytree(CONFIGS, tmp_path_factory.mktemp("upstream") / "robovast-configs")
    return {row.file: row for row in rows_of(folder, Trial(sample=2))}


def test_expectations_cover_all_files(rows):
    assert sorted(rows) == sorted(EXPECTED)


@pytest.mark.parametrize("file", EXPECTED)
def test_file_fares_no_worse_than_it_did(rows, file):
    if not ROBOVAST and (missing := missing_programs(file)):
        pytest.skip(f"no {', '.join(missing)} beside {file}: {NO_CONFIGS}")
    row, expected = rows[file], EXPECTED[file]
    assert RANKS.index(row.outcome) >= RANKS.index(expected["outcome"]), row
    assert row.configurations >= expected["configurations"], row
    assert row.broken <= expected["broken"], row
    if expected["sent"]:
        assert row.sent and row.drove / row.sent >= expected["drove"] / expected["sent"], row
