"""Columns of the tables of a campaign directory, against row-by-row counting, and factors of its configurations."""

import json
import math
import re
from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import walled_room, write_map
from table import each_row

from vastflow.oracles.judgment.verdict import run_judgment
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.results import schema
from vastflow.oracles.results.executed import NAMED_FILES, KeptFiles, environment_names, kept_map, scenario_of_row
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.tables import CODES, ConfigurationTable, VerdictTable
from vastflow.oracles.results.units import units_of
from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.files import read_bytes
from vastflow.sim.model.shape import Box
from vastflow.sim.plug_ins import neighbors
from vastflow.sim.plug_ins.snapshot import snapshot_of
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.world import map_content

NAMES = ["a", "b", "c"]


def verdict(configuration="a", run_index=0, oracle="success", judgment="pass", reason="", **metrics):
    values = {name: {"value": value, "unit": "m"} for name, value in metrics.items()}
    run = {"configuration": configuration, "run_index": run_index, "oracle": oracle}
    return {**run, "judgment": judgment, "reason": reason, "metrics": json.dumps(values)}


def table_of(rows, names=NAMES):
    return VerdictTable(pa.Table.from_pylist(rows, schema.VERDICTS), names)


said = st.dictionaries(
    st.tuples(st.sampled_from(NAMES), st.integers(0, 30), st.sampled_from(["success", "safety", "own.py:Judge"])),
    st.sampled_from(list(CODES)),
    max_size=40,
)


@settings(deadline=None)
@given(said, st.randoms(use_true_random=False))
def test_counts_match_rows_in_any_order(judged, random):
    keys = list(judged)
    random.shuffle(keys)
    table = table_of([verdict(*key, judged[key]) for key in keys])
    assert set(table.oracles) == {oracle for _, _, oracle in judged}
    for oracle in table.oracles:
        counted = Counter((name, judged[name, run, of]) for name, run, of in judged if of == oracle)
        assert table.counts(oracle).tolist() == [[counted[name, word] for word in CODES] for name in NAMES]
    runs = {}
    for (name, run, _), judgment in judged.items():
        runs.setdefault((name, run), []).append(judgment)
    together = Counter((name, run_judgment(judgments)) for (name, _), judgments in runs.items())
    assert len(table) == len(runs)
    assert table.counts(None).tolist() == [[together[name, word] for word in CODES] for name in NAMES]


def test_metrics_are_aligned_with_runs():
    timed = [verdict(name, run, time=value) for name, run, value in (("b", 1, 2.5), ("b", 0, None), ("a", 7, 3))]
    table = table_of([*timed, verdict("a", 7, "safety", depth=1.0)])
    time = table.metrics("success")["time"]
    assert time.unit == "m"
    assert time.values[[0, 2]].tolist() == [3.0, 2.5] and math.isnan(time.values[1])
    assert [NAMES[k] for k in table.configuration] == ["a", "b", "b"]
    assert table.run_index.tolist() == [7, 0, 1]
    assert list(table.metrics("safety")) == ["depth"]
    time = table_of([verdict(time=None)]).metrics("success")["time"]
    assert time.unit == "m" and np.isnan(time.values).all()
    assert table_of([verdict()]).metrics("success") == {}


def test_reasons_belong_to_one_judgment():
    table = table_of([verdict(reason="no"), verdict("b", 3, judgment="fail", reason="too late")])
    reasons = table.reasons("fail")
    assert (reasons.configuration.tolist(), reasons.reason.tolist()) == (["b"], ["too late"])
    with pytest.raises(ValueError, match=r"verdicts.parquet judges 'z', which is no row of configurations.parquet"):
        table_of([verdict("z")])
    with pytest.raises(ValueError, match=r"has the judgment 'maybe'\. It can be pass, fail, not judged"):
        table_of([verdict(judgment="maybe")])
    with pytest.raises(ValueError, match="JSON"):
        table_of([verdict(), {**verdict(run_index=1), "metrics": "{broken"}]).metrics("success")


def test_null_is_empty_text_or_nan():
    found, known = schema.codes(pa.chunked_array([["a", None], ["a", ""]]))
    assert [known[k] for k in found] == ["a", "", "a", ""]
    assert np.isnan(schema.floats(pa.array([None, 1.0])[0:1])).all()
    assert schema.floats(pa.array([1.0, None, 3.0]).slice(2)).tolist() == [3.0]
    assert schema.integers(pa.chunked_array([pa.array([1, 2, 3]).slice(1), [4]])).tolist() == [2, 3, 4]


def test_columns_of_configurations_are_decoded():
    row = {
        "name": "a", "family": "f", "duplicate_of": None, "environment": None, "abstract": '{"file": "x"}',
        "scenario": '{"task": {}}', "factors": '{"noise": 0.1}', "provenance": "{}",
    }  # fmt: skip
    table = ConfigurationTable(pa.Table.from_pylist([row, {**row, "name": "b", "duplicate_of": "a", "abstract": "n"}]))
    assert table.factors[1] == {"noise": 0.1}
    assert (table.distinct.tolist(), table.duplicates) == ([0], {"b": "a"})
    assert [each["abstract"] for each in table.rows()] == [{"file": "x"}, "n"]
    assert table.rows()[0]["scenario"] == {"task": {}}


def test_behaviors_of_configuration_are_read_from_every_row_group(tmp_path):
    said = {"t_s": [0.5, 1.5, 2.5, 3.5], "name": ["drive", "wait", "", "drive"]}
    table = pa.table({"configuration": ["a", "b", "b", "c"], "run_index": [0, 0, 1, 0], **said})
    pq.write_table(table, tmp_path / schema.BEHAVIORS_FILE, row_group_size=2)
    found = {name: column.tolist() for name, column in schema.behaviors_of(tmp_path, "b").items()}
    assert found == {"run_index": [0, 1], "t_s": [1.5, 2.5], "name": ["wait", ""]}
    assert [schema.behaviors_of(tmp_path, name)["t_s"].tolist() for name in ("c", "a")] == [[3.5], [0.5]]
    assert [column.dtype for column in schema.behaviors_of(tmp_path, "a").values()] == [np.int64, np.float64, object]
    assert schema.behaviors_of(tmp_path, "d") == schema.behaviors_of(tmp_path / "elsewhere", "a") == {}
    (tmp_path / schema.BEHAVIORS_FILE).write_bytes(b"damaged")
    with pytest.raises(ValueError, match="Parquet"):
        schema.behaviors_of(tmp_path, "b")


def test_kept_files_are_found_by_digest(tmp_path):
    plan, mesh = tmp_path / "inputs" / "deep" / "plan.fpm", tmp_path / "environments" / "e" / "mesh.stl"
    for file in (plan, mesh):
        file.parent.mkdir(parents=True)
        file.write_text(file.name)
    (tmp_path / "environments" / NAMED_FILES).write_text(json.dumps({"5011d": "e/mesh.stl"}))
    files = KeptFiles(tmp_path)
    assert (files.path(file_digest(plan)), files.path("5011d")) == (plan, mesh)
    with pytest.raises(ValueError, match=re.escape("no file has the digest 0123456789ab… that the scenario names")):
        files.path("0123456789abcdef")


def test_scenarios_and_situations_of_kept_rows_load_no_plug_in(tmp_path):
    own, shape = [{"file": "a" * 64}, "Own"], {"length_m": 0.6, "width_m": 0.4}
    task = {"start_pose": {"x": 1.0, "y": 1.0}, "goal_pose": {"x": 2.0, "y": 1.0}}
    movers = {"movers": [{"name": "cart", "shape": shape, "rule": own, "x_m": 2.0}]}
    system = {"robot.lidar.noise.model": own}
    content = json.dumps({"environment": movers, "task": task, "system": system})
    row = {"abstract": "builtin:navigate_to_pose", "scenario": content, "timeout_s": 20.0}
    scenario = scenario_of_row(row, KeptFiles(tmp_path))
    assert situation_of(scenario).movers == {"cart": Box(0.6, 0.4)}  # no file has such a digest


def test_kept_plug_in_is_found_and_reads_nothing_outside_of_its_directory(tmp_path, monkeypatch):
    inputs, secret = tmp_path / "results" / "inputs", tmp_path / "secret.txt"
    inputs.mkdir(parents=True)
    secret.write_text("secret")
    (inputs / "own.py").write_text("class Own(Mover):\n    pass\n")
    digest = snapshot_of(inputs / "own.py", inputs).digest
    (inputs / "a.py").write_text('class A(Mover):\n    files = ["../../secret.txt"]\n')
    (inputs / "b.py").write_text('class B(Mover):\n    files = ["../.."]\n')
    (inputs / "c.py").write_text("import helper\n")
    (inputs / "helper.py").symlink_to(secret)
    read = []
    monkeypatch.setattr(neighbors, "read_bytes", lambda file, *more: read.append(file.name) or read_bytes(file, *more))
    found = KeptFiles(inputs.parent, plug_ins=True).plug_in(digest, "Own")
    assert (found[0].path, found[0].digest, found[1]) == (str(inputs / "own.py"), digest, "Own")
    assert KeptFiles(inputs.parent, plug_ins=True).plug_in("b" * 64, "Own") == f"{'b' * 64}.py:Own"
    assert KeptFiles(inputs.parent).plug_in(digest, "Own") == f"{digest}.py:Own"
    assert {*read} == {"a.py", "b.py", "c.py", "own.py"}


@pytest.mark.parametrize("leads_out", ["link to the file", "link to another file", "link to the picture", "image"])
def test_map_of_a_directory_that_leads_out_of_it_is_not_read(tmp_path, leads_out):
    elsewhere, directory = tmp_path / "elsewhere", tmp_path / "results"
    own = write_map(elsewhere, walled_room(2.0, 2.0))
    digest, picture = map_content(own).digest, elsewhere / "map.pgm"
    for folder in (directory / "inputs", directory / "environments" / digest):
        folder.mkdir(parents=True)
        file = folder / "map.yaml"
        if leads_out in ("link to the file", "link to another file"):
            file.symlink_to(own if leads_out == "link to the file" else picture)
        else:
            file.write_text(
                own.read_text().replace("image: ", f"image: {elsewhere}/" if leads_out == "image" else "image: ")
            )
        if leads_out == "link to the picture":
            (folder / picture.name).symlink_to(picture)
    assert environment_names(directory, [digest]) == {digest: digest[:8]}
    with pytest.raises(WorldError, match="expected the files of a world in"):
        kept_map(directory, digest)
    with pytest.raises(ValueError, match="no file has the digest"):
        KeptFiles(directory).path(digest)


PLACES = [{"static_objects": [{"x": k}] * n, "start_pose": {"x": float(k)}} for n in (0, 2) for k in range(3)]
NO_FACTOR = "is a place or a list, and not one of a few values"
SIZES = [{"map": m, "size": {"A": 3, "B": 1}[m]} for m in "ABBA"]
QUARTERS, THIRDS = ("0 to 24", "25 to 49", "50 to 74", "75 to 99"), ("5 to 5.18", "10 to 10.18", "30 to 30.18")
HEAPS = [wanted + 0.02 * k for wanted in (5.0, 10.0, 30.0) for k in range(10)]


@each_row(
    ("rows", "factors", "dropped"),
    [
        ([], [], []),
        ([{}, {}], [], []),
        ([{"speed": 0.5}, {"speed": 0.5}], [], []),
        # Levels stand in natural order.
        (
            [{"noise": v, "planner": p} for v in (0.1, 0.02, 0.1) for p in ("b", "a")],
            [("noise", ("0.02", "0.1"), [1, 1, 0, 0, 1, 1]), ("planner", ("b", "a"), [0, 1, 0, 1, 0, 1])],
            [],
        ),
        ([{"a": 1}, {"a": 2}, {}], [("a", ("1", "2"), [0, 1, -1])], []),
        # Many numbers are binned at quantiles, or grouped by their gaps.
        ([{"drawn": float(v)} for v in range(100)], [("drawn", QUARTERS, [k // 25 for k in range(100)])], []),
        ([{"length": v} for v in HEAPS], [("length", THIRDS, [k // 10 for k in range(30)])], []),
        (PLACES, [("number of static_objects", ("0", "2"), [0, 0, 0, 1, 1, 1])], [("start_pose", NO_FACTOR)]),
        ([{"map": {"file": letter * 64}} for letter in "ab"], [("map", ("a" * 12, "b" * 12), [0, 1])], []),
        (SIZES, [("map", ("A", "B"), [0, 1, 1, 0])], [("size", "divides the configurations as map does")]),
        ([{"seed": f"s{k}"} for k in range(20)], [], [("seed", "has 20 different values, at most 12 can be compared")]),
        ([{"a": 1}, {}], [], [("a", "has one value where it is given at all")]),
    ],
)
def test_factors_of_finds_levels(rows, factors, dropped):
    found, left = factors_of(rows)
    assert [(each.name, each.levels, each.codes.tolist()) for each in found] == factors
    assert [(each.name, each.reason) for each in left] == dropped


@given(st.lists(st.floats(-1e3, 1e3), min_size=14, max_size=40, unique=True))
def test_factors_of_gives_each_number_a_level_in_order(values):
    (factor,), _ = factors_of([{"drawn": v} for v in values])
    assert 2 <= len(factor.levels) <= 12
    assert factor.codes.min() == 0
    assert (np.diff(factor.codes[np.argsort(values)]) >= 0).all()
    assert factor.values.tolist() == values


def test_factors_of_keeps_finite_numbers_as_values():
    rows = [{"noise": 0.1, "planner": "a"}, {"noise": None, "planner": "a"}, {"noise": 0.2, "planner": "b"}]
    (number, word), _ = factors_of(rows)
    assert word.values is None
    assert np.array_equal(number.values, [0.1, np.nan, 0.2], equal_nan=True)
    (factor,), _ = factors_of([{"range": 1.0}, {"range": 2.0}, {"range": float("inf")}])
    assert (len(factor.levels), factor.values) == (3, None)


def scenario_at(where, goal_m, rounds=1, **system):
    task = {"goal_pose": {"position": {"x": goal_m}}, "rounds": rounds}
    return {"environment": {"map_file": {"file": where}, **system}, "task": task, "system": system}


@each_row(
    ("places", "codes", "noun", "others"),
    [
        ([("a", 1), ("a", 1, 2), ("a", 2), ("a", 3)], [0, 0, 1, 2], "path", "paths on this map"),
        ([("a", 1), ("b", 1), ("a", 2), ("b", 2)], [0, 0, 1, 1], "path", "paths on these 2 maps"),
        ([("a", 1), ("a", 2), ("b", 3), ("b", 4)], [0, 1, 2, 3], "path", "paths on these 2 maps"),
        ([("a", 1), ("b", 1), ("c", 1)], [0, 1, 2], "map", "maps with this path"),
        ([("a", 1), ("b", 1), ("c", 2)], [0, 1, 2], "map", "maps with these paths"),
    ],
)
def test_units_are_paths_unless_maps_outnumber_them(places, codes, noun, others):
    found = units_of([scenario_at(*place, noise=k) for k, place in enumerate(places)])
    assert (found.codes.tolist(), found.noun, found.others) == (codes, noun, others)


def test_programs_without_map_and_task_share_nothing():
    found = units_of([{"environment": {}, "task": {}, "system": {"a": 1}}] * 3)
    assert (len(set(found.codes.tolist())), found.noun, found.others) == (3, "situation", "situations")


DEEP = '{"a":' * 20_000 + "1" + "}" * 20_000


@each_row(
    ("text", "message"),
    [
        (DEEP, "more than 100 levels deep"),
        ('{"time": 1}', "metric 'time': expected a value with a unit, got int64"),
        ('{"time": [{"value": 1.0}]}', "metric 'time': expected a value with a unit, got list"),
    ],
)
def test_metrics_of_another_form_are_refused(text, message):
    """Deep ones ended the process, as pyarrow's parser recurses."""
    row = {"configuration": "a", "family": "a", "run_index": 0, "oracle": "o", "judgment": "pass", "metrics": text}
    with pytest.raises(ValueError, match=message):
        VerdictTable(pa.Table.from_pylist([row], schema.VERDICTS), ["a"]).metrics("o")


def test_column_of_json_has_an_object_in_each_row():
    rows = [{"name": "a", "factors": '{"x": 1}, {"x": 2}'}, {"name": "b", "factors": "[]"}]
    for some in (rows[:1], rows[1:], [{**rows[0], "factors": "[" * 20_000}]):
        with pytest.raises((ValueError, RecursionError), match=r"expected a JSON object in each row|recursion"):
            _ = ConfigurationTable(pa.Table.from_pylist(some, schema.CONFIGURATIONS)).factors
