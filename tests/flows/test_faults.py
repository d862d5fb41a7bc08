"""A scenario that can't work: a fault of its runs, and no failure of anything."""

import pytest
from command_line import called

from vastflow.oracles.results.tables import read_tables

pytestmark = pytest.mark.slow

SCENARIO = """\
import osc.helpers

scenario tool:
    timeout(20s)
    program: string = "true"
    do serial:
        run_process(program)
"""
CAMPAIGN = """\
version: 1
metadata: {name: tools}
configuration:
  - name: tool
    variations:
      - ParameterVariationList: {name: program, values: ["true", "no-such-tool --now", "sh -c 'exit 127'"]}
execution: {runs: 2, scenario_file: tool.osc}
"""


def test_program_that_cannot_be_started_is_fault_and_in_no_rate(tmp_path):
    (tmp_path / "tool.osc").write_text(SCENARIO)
    (tmp_path / "tools.vast").write_text(CAMPAIGN)

    places = ("--results", tmp_path / "results", "--store", tmp_path / "store", "--workers", 1)
    done = called("run", tmp_path / "tools.vast", *places)
    assert done.exit_code == 3
    why = "'no-such-tool' could not be started: no program of this name in PATH; run_process at tool.osc:7:9"
    assert f"fault: tool-2 run 0, execute: {why}" in done.stdout
    (directory,) = (tmp_path / "results").iterdir()
    tables = read_tables(directory)
    counts = tables.metadata["counts"]
    assert (counts["passed"], counts["failed"], counts["not_judged"], counts["executed"]) == (2, 2, 2, 4)
    faulty = [row for row in tables.verdicts.rows() if row["configuration"] == "tool-2"]
    assert {(row["judgement"], row["reason"]) for row in faulty} == {("not judged", f"fault in execute: {why}")}
    assert "tool-2" not in tables.runs["configuration"].to_pylist()
    assert "2 runs not judged, 2 faults" in " ".join((directory / "report.html").read_text().split())
