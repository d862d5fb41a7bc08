"""RoboVAST's own configurations, where they lie beside the repository, still run.

`expected.json` has for each file what `table.py` said of it with two configurations of a campaign and one run of each. A row that
is better than that fails nothing; one that got worse does.
"""

import json
import shutil
import sys
from pathlib import Path

import pytest
from table import each_row

UPSTREAM = Path(__file__).parents[3] / "shared" / "upstream" / "robovast-configs"
EXPECTED = json.loads((Path(__file__).parent / "expected.json").read_text())
RANKS = ("refused", "valid", "ran")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not UPSTREAM.is_dir(), reason="RoboVAST's configurations are not beside the repository"),
    pytest.mark.timeout(2400),  # the first of them executes all files
]


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    sys.path.insert(0, str(Path(__file__).parent))
    try:
        from rows import Trial, rows_of
    finally:
        sys.path.pop(0)
    folder = shutil.copytree(UPSTREAM, tmp_path_factory.mktemp("upstream") / UPSTREAM.name)
    return {row.file: row for row in rows_of(folder, Trial(sample=2))}


def test_expectations_cover_all_files(rows):
    assert sorted(rows) == sorted(EXPECTED)


@each_row("file", EXPECTED)
def test_file_fares_no_worse_than_it_did(rows, file):
    row, expected = rows[file], EXPECTED[file]
    assert RANKS.index(row.outcome) >= RANKS.index(expected["outcome"]), row
    assert row.configurations >= expected["configurations"], row
    assert row.broken <= expected["broken"], row
    if expected["sent"]:
        assert row.sent and row.drove / row.sent >= expected["drove"] / expected["sent"], row
