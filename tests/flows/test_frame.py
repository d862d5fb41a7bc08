"""The table of a campaign's runs in pandas."""

import json
import runpy
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from vastflow.oracles.evidence.wide import WIDE_FILE, wide_table, write_wide
from vastflow.oracles.judgment.notebook import read_cells
from vastflow.oracles.results.schema import CONFIGURATIONS, REJECTIONS, RUNS, VERDICTS
from vastflow.oracles.results.tables import read_tables

NOTEBOOK = Path(__file__).parents[2] / "campaigns" / "notebook" / "success_by_factor.ipynb"
SAID = {"p": "pass", "f": "fail", "n": "not judged"}


def write(folder, configurations, *, unrecorded=()):
    """A campaign directory: name to family, factors, and a letter a run; `unrecorded` are names and indices of runs."""
    rows, runs, verdicts = [], [], []
    for name, (family, factors, said) in configurations.items():
        content = {"environment": {}, "task": {"goal": name}, "system": {}}
        texts = {"scenario": json.dumps(content), "factors": json.dumps(factors), "provenance": "{}"}
        rows.append({"name": name, "family": family, "abstract": "builtin:navigate_to_pose", **texts})
        for k, letter in enumerate(said):
            run = {"configuration": name, "family": family, "run_index": k}
            if (name, k) not in unrecorded:
                runs.append({**run, "seed": f"{name}{k}", "outcome": "reached", "distance_m": k + 0.5, "contacts": 0})
            metrics = {"min_distance": {"value": 0.1 * k, "unit": "m"}} if letter != "n" else {}
            verdicts += [
                {**run, "oracle": "success", "judgment": "pass", "reason": "", "metrics": "{}"},
                {**run, "oracle": "safety", "judgment": SAID[letter], "reason": "", "metrics": json.dumps(metrics)},
            ]
    tables = {"configurations": (rows, CONFIGURATIONS), "runs": (runs, RUNS)}
    tables |= {"verdicts": (verdicts, VERDICTS), "rejections": ([], REJECTIONS)}
    for table, (content, schema) in tables.items():
        pq.write_table(pa.Table.from_pylist(content, schema), folder / f"{table}.parquet")
    (folder / "campaign.vast").write_text("version: 1\n")
    (folder / "metadata.json").write_text(json.dumps({"name": "a", "created": "2026-11-22T06:00:00"}))
    return folder


def frame(directory):
    return wide_table(read_tables(directory))


def test_frame_has_a_row_per_run_with_factors_outcome_and_verdicts(tmp_path):
    runs = frame(write(tmp_path, {"a": ("f", {"noise": 0.4, "map": "rooms"}, "pf")}))
    row = runs.iloc[1].to_dict()
    said = {"configuration": "a", "family": "f", "run_index": 1, "noise": 0.4, "map": "rooms"}
    assert {name: row[name] for name in said} == said
    assert (row["outcome"], row["distance_m"], row["safety.min_distance (m)"]) == ("reached", 1.5, pytest.approx(0.1))
    assert (row["passed"], row["passed.success"], row["passed.safety"]) == (False, True, False)


def test_frame_has_row_without_outcome_for_unrecorded_run(tmp_path):
    runs = frame(write(tmp_path, {"a": ("f", {"noise": 1}, "pn")}, unrecorded={("a", 1)}))
    for column in ("passed", "safety.min_distance (m)", "distance_m", "outcome"):
        assert runs[column].isna().tolist() == [False, True]
    assert runs["passed"].mean() == 1.0
    assert runs["noise"].tolist() == [1.0, 1.0]


def test_frame_prefixes_factor_named_like_other_column(tmp_path):
    runs = frame(write(tmp_path, {"a": ("f", {"factor.passed": 1, "passed": 3, "outcome": 2}, "p")}))
    assert (runs["factor.passed"].tolist(), runs["factor.factor.passed"].tolist()) == ([1.0], [3.0])
    assert runs["factor.outcome"].tolist() == [2.0] and runs["outcome"].tolist() == ["reached"]
    assert runs["passed"].tolist() == [True]


def test_frame_writes_factor_of_numbers_and_texts_as_text(tmp_path):
    families = {"a": ("f", {"speed": 0.5}, "p"), "b": ("g", {"speed": "fast"}, "p"), "c": ("h", {}, "p")}
    runs = frame(write(tmp_path, families))
    assert runs["speed"].tolist()[:2] == ["0.5", "fast"]
    assert runs["speed"].isna().tolist() == [False, False, True]


def test_wide_file_equals_frame(tmp_path):
    families = {"a": ("f", {"speed": 0.5, "map": "rooms"}, "pfn"), "b": ("g", {"speed": "fast"}, "p")}
    write(tmp_path, families, unrecorded={("a", 1)})
    write_wide(tmp_path, wide_table(read_tables(tmp_path)))
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / WIDE_FILE), frame(tmp_path), check_categorical=False)


def test_notebook_computes_success_by_factor_in_two_lines(tmp_path, monkeypatch):
    write(tmp_path, {"quiet": ("f", {"noise": 0.0}, "pppn"), "loud": ("f", {"noise": 0.4}, "ppff")})
    write_wide(tmp_path, wide_table(read_tables(tmp_path)))
    monkeypatch.chdir(tmp_path)
    (imports, cell) = read_cells(NOTEBOOK)
    assert len(cell.code.strip().splitlines()) == 2
    code = cell.code.replace("laserscan_gaussian_noise_std_deviation", "noise")
    Path("cells.py").write_text(f"{imports.code}\n{code}\n")
    assert runpy.run_path("cells.py")["success"].to_dict() == {0.0: 1.0, 0.4: 0.5}
