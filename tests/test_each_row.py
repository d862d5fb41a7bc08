"""Rows of a case are reported as what they are: failed, skipped, or passed."""

import os
import subprocess
import sys
from pathlib import Path

from table import each_row

ROWS = """\
import pytest
from table import each_row


@each_row("number", [1, 2, 3])
def test_row(number):
    if number in {skipped}:
        pytest.skip("not on this machine")
    assert number not in {failed}
"""


def report_of(folder, skipped, failed, *options):
    """Run a case of three rows with our plug-ins, and return the exit code and what pytest printed."""
    (folder / "test_rows.py").write_text(ROWS.format(skipped=skipped, failed=failed))
    tests = Path(__file__).parent
    command = [sys.executable, "-m", "pytest", "-q", "-rs", "-c", str(tests.parent / "pyproject.toml"), *options]
    called = subprocess.run(
        [*command, "-p", "conftest", "-p", "no:cacheprovider", str(folder)],
        env={**os.environ, "PYTHONPATH": f"{tests}:{tests / 'support'}"},
        check=False,
        capture_output=True,
        text=True,
    )
    return called.returncode, called.stdout


@each_row("options", [("-p", "no:xdist"), ("-n", "1")])
def test_row_reports_its_skip_with_its_reason(tmp_path, options):
    code, report = report_of(tmp_path, [1, 3], [], *options)
    assert code == 0
    assert report.count(": not on this machine") == 2, report
    assert "row 0: (1,): not on this machine" in report and "row 2: (3,): not on this machine" in report, report
    assert "1 passed, 2 skipped" in report, report


def test_case_is_skipped_where_each_of_its_rows_is(tmp_path):
    code, report = report_of(tmp_path, [1, 2, 3], [])
    assert code == 0 and "each row was skipped" in report, report
    assert "4 skipped" in report and "passed" not in report, report


def test_row_fails_beside_a_skipped_one(tmp_path):
    code, report = report_of(tmp_path, [1], [2])
    assert code == 1 and "row 0: (1,): not on this machine" in report, report
    assert "2 failed, 1 skipped" in report, report
