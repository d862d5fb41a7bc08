"""Notebooks as oracles."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from table import each_row

from vastflow.oracles.judgment.conformance import CHECKS, SampleRun, sample_runs
from vastflow.oracles.judgment.notebook import SIGNALS, run_tables
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.oracles.judgment.registry import OracleError, oracle_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.tasks.keys.source import installed_tree

EXAMPLE = Path(__file__).parents[2] / "campaigns" / "notebook"

LEAVES = """\
metrics = {"distance": "m"}
verdicts = [
    {"run_index": run["run_index"], "judgment": "pass", "distance": run["distance_m"]} for run in runs.to_pylist()
]
"""


def cell(code: str, *tags: str, kind: str = "code") -> dict[str, Any]:
    return {"cell_type": kind, "metadata": {"tags": list(tags)}, "source": code.splitlines(True)}


def written(folder: Path, *cells: dict[str, Any] | str, nbformat: int = 4) -> Path:
    whole = [cell(each) if isinstance(each, str) else each for each in cells]
    (folder / "judge.ipynb").write_text(json.dumps({"cells": whole, "metadata": {}, "nbformat": nbformat}))
    return folder


def notebook(folder: Path, *cells: dict[str, Any] | str, **parameters: Any) -> Oracle[Any]:
    return oracle_of("judge.ipynb", parameters, written(folder, *cells))


def run_called(name: str) -> SampleRun:
    (found,) = (run for run in sample_runs() if run.name == name)
    return found


CORRIDOR = run_called("an empty corridor")


@each_row("check", CHECKS)
def test_example_notebook_keeps_contract(check):
    check(oracle_of("lost.ipynb", {"max_error_m": 0.025}, EXAMPLE), sample_runs())


def test_example_notebook_counts_time_driven_while_lost():
    # The sample's error is 0.02 + 0.01 sin(k) m at row k, and it drives at all rows but the last.
    rows = sum(math.sin(k) > 0.5 for k in range(1, 100))
    verdict = oracle_of("lost.ipynb", {"max_error_m": 0.025}, EXAMPLE).judge(CORRIDOR.trace, CORRIDOR.situation)
    assert verdict.metrics["lost_time"].value == pytest.approx(0.1 * rows) == 3.4
    assert verdict.reason == "drove for 3.4 s more than 0.025 m from where it believed to be"


def test_parameters_of_campaign_replace_defaults_of_notebook(tmp_path) -> None:
    parameters = cell("limit = 1.5\nword: str = 'slow'", "parameters")
    fails = "verdicts = [{'run_index': 3, 'judgment': 'fail', 'reason': f'{word} {limit}'}]"
    assert notebook(tmp_path, parameters, fails).judge(CORRIDOR.trace, CORRIDOR.situation).reason == "slow 1.5"
    said = notebook(tmp_path, parameters, fails, limit=2).judge(CORRIDOR.trace, CORRIDOR.situation)
    assert said.reason == "slow 2.0"
    with pytest.raises(OracleError, match=r"judge\.ipynb\.limt: Unknown key 'limt'\. Did you mean 'limit'"):
        notebook(tmp_path, cell("limit = 1.5", "parameters"), LEAVES, limt=2)


def judged(folder, *cells):
    verdict = notebook(folder, *cells).judge(CORRIDOR.trace, CORRIDOR.situation)
    return verdict.judgment, verdict.reason, {name: metric.value for name, metric in verdict.metrics.items()}


def test_notebook_leaves_verdicts_as_rows_or_table(tmp_path, capsys):
    skipped = cell("%matplotlib inline", "skip-execution"), cell("Some words.", kind="markdown")
    assert judged(tmp_path, *skipped, "print('hello')", LEAVES) == ("pass", "", {"distance": 5.0})
    assert capsys.readouterr().out == ""
    unjudged = "the notebook has no verdict on this run"
    assert judged(tmp_path, "verdicts = []") == ("not judged", unjudged, {})
    table = "import pyarrow as pa\nverdicts = pa.table({'run_index': [3], 'judgment': ['pass'], 'd': [float('nan')]})"
    frame = f"{table}.to_pandas()"
    for leaves in (table, frame):
        assert judged(tmp_path, "metrics = {'d': 'm'}", leaves) == ("pass", "", {"d": None})


def test_notebook_of_former_version_judges_and_warns(tmp_path):
    table = (
        "import pyarrow as pa\nverdicts = pa.table({'run_index': [3], 'judgement': ['fail'], 'reason': ['too slow']})"
    )
    with pytest.warns(DeprecationWarning, match="judge.ipynb: 'judgement' goes with the next version"):
        assert judged(tmp_path, table) == ("fail", "too slow", {})


SAID = "'run_index': 3, 'judgment': "


@each_row(
    ("left", "message"),
    [
        ("pass", "judge.ipynb sets no 'verdicts'"),
        ("verdicts = [{'run_index': 8}]", r"verdict 1: expected one of the runs \[3\], got run_index 8"),
        (f"verdicts = [{{{SAID}'ok'}}]", "expected one of 'pass', 'fail', 'not judged', got judgment 'ok'"),
        (f"verdicts = [{{{SAID}'fail'}}]", "verdict 1: 'fail' without a reason"),
        (f"verdicts = 2 * [{{{SAID}'pass'}}]", "verdict 2: duplicate verdict on run 3"),
        (f"verdicts = [{{{SAID}'pass', 'x': 1}}]", "unknown metric 'x'"),
        ("a = 1\nb = a / 0", "judge.ipynb: cell 2, line 2: ZeroDivisionError: division by zero"),
    ],
)
def test_notebook_without_valid_verdicts_is_broken(tmp_path, left: str, message: str) -> None:
    oracle = notebook(tmp_path, "first = 1", left)
    with pytest.raises(PlugInError, match=message):
        oracle.judge(CORRIDOR.trace, CORRIDOR.situation)


@each_row(
    ("cells", "message"),
    [
        (["%time 1"], "cell 1, line 1: expected Python, got '%time 1'.*Tag .* 'skip-execution'"),
        ([cell("import numpy", "parameters")], "cell 1, line 1: expected name = literal, got 'import numpy'"),
        (["metrics = {'a': 1}"], r"cell 1: expected names and units, got metrics = \{'a': 1\}"),
    ],
)
def test_notebook_with_other_code_is_refused(tmp_path, cells: list[Any], message: str) -> None:
    with pytest.raises(OracleError, match=message):
        notebook(tmp_path, *cells)


def test_file_of_other_format_is_refused(tmp_path) -> None:
    with pytest.raises(OracleError, match="nbformat: expected a notebook of format 4, got 3"):
        oracle_of("judge.ipynb", {}, written(tmp_path, LEAVES, nbformat=3))
    (tmp_path / "judge.ipynb").write_text("not JSON")
    with pytest.raises(OracleError, match=r"judge\.ipynb: It is not JSON: Expecting value"):
        oracle_of("judge.ipynb", {}, tmp_path)
    for damage, message in (
        ({"cells": [{"source": "x = 1"}], "nbformat": 4}, "cells.0.cell_type: expected a notebook of format 4, got "),
        ({"cells": {}, "nbformat": 4}, "cells: expected a notebook of format 4, got {}"),
        ([], r"content: expected a notebook of format 4, got \[\]"),
        ({"cells": [{"cell_type": "code", "source": "x\0"}], "nbformat": 4}, "cell 1: .*null bytes"),
        ({"cells": [{"cell_type": "code", "source": "(" * 3000}], "nbformat": 4}, "cell 1"),
    ):
        (tmp_path / "judge.ipynb").write_text(json.dumps(damage))
        with pytest.raises(OracleError, match=message):
            oracle_of("judge.ipynb", {}, tmp_path)
    with pytest.raises(
        OracleError, match=r"There is no file .*absent\.ipynb'\. Expected a notebook beside the campaign file"
    ):
        oracle_of("absent.ipynb", {}, tmp_path)


def source_of(folder, *cells):
    return installed_tree().plug_in_digest(type(notebook(folder, *cells)))


def test_source_digest_of_notebook_follows_from_executed_code(tmp_path):
    prose, look = cell("words", kind="markdown"), cell("%time 1", "skip-execution")
    before = source_of(tmp_path, LEAVES)
    assert source_of(tmp_path, prose, look, {**cell(LEAVES), "outputs": [1], "execution_count": 7}) == before
    assert source_of(tmp_path, f"# a comment\n{LEAVES}") == before
    assert source_of(tmp_path, f"x = 1\n{LEAVES}") != before
    assert source_of(tmp_path, "a = 1", LEAVES) != source_of(tmp_path, cell("a = 1", "parameters"), LEAVES)


def test_run_tables_have_rows_of_all_runs():
    late = run_called("an obstacle that appears late")
    tables = run_tables([CORRIDOR.trace, late.trace], late.situation)
    assert tables.traces.num_rows == len(CORRIDOR.trace) + len(late.trace)
    assert tables.traces["appearing_clearance_m"].null_count == len(CORRIDOR.trace)
    assert tables.runs["outcome"].to_pylist() == ["succeeded", "timed_out"]
    spawned = {"t_s": 5.0, "kind": "spawned", "x_m": 3.5, "y_m": 0.0, "what": "carton", "value": 0.0}
    assert tables.runs["events"][1].as_py() == [spawned]
    for traces in ([run_called("no robot").trace], []):
        tables = run_tables(traces, CORRIDOR.situation)
        assert tables.traces.column_names == ["run_index", *SIGNALS]
        assert (tables.traces.num_rows, tables.runs.num_rows) == (0, len(traces))
