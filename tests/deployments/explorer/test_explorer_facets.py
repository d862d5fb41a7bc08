"""Facets, pages of configurations, points, and maps of selected runs."""

import numpy as np
import pandas as pd
import pytest

from vastflow.deployments.explorer.configuration_page import neighbor
from vastflow.deployments.explorer.trajectories import STEP_M, join_paths, layer, paths_of
from vastflow.oracles.query.facets import (
    BINS,
    Chosen,
    Facets,
    points,
    reasons_json,
    rows_json,
    summary_json,
    varying_of,
)
from vastflow.oracles.query.selection import WIDE_FILE, is_by_result, mask_of, parse_filter, read_run_table
from vastflow.oracles.statistics.failure_map import failure_map, grid_over

CONFIGURATIONS, RUNS = 30, 8


def runs_of():
    rng = np.random.default_rng(4)
    n = CONFIGURATIONS * RUNS
    of = np.repeat(np.arange(CONFIGURATIONS), RUNS)
    noise, length = rng.choice([0.0, 0.2, 0.4], CONFIGURATIONS)[of], rng.uniform(4.0, 9.0, CONFIGURATIONS)[of]
    failed = rng.random(n) < 0.1 + noise
    return pd.DataFrame(
        {
            "configuration": pd.Categorical.from_codes(of, [f"c-{k}" for k in range(CONFIGURATIONS)]),
            "family": pd.Categorical.from_codes(of % 2, ["odd", "even"]),
            "run_index": np.tile(np.arange(RUNS), CONFIGURATIONS),
            "reason": pd.Categorical.from_codes(
                np.where(failed, rng.integers(0, 20, n), -1), [f"r{k}" for k in range(20)]
            ),
            "cause": pd.Categorical.from_codes(np.where(failed, 0, -1), ["lost"]),
            "passed": pd.arrays.BooleanArray(~failed, rng.random(n) < 0.1),
            "passed.safety": pd.arrays.BooleanArray(~failed, np.zeros(n, dtype=bool)),
            "safety.margin (m)": np.where(rng.random(n) < 0.1, np.nan, rng.normal(0.0, 1.0, n)),
            "noise": noise,
            "path length (m)": length,
            "robot": pd.Categorical(["turtle"] * n),
            "purpose": pd.Categorical.from_codes((np.arange(n) * 7 % 11 < 3) * 1, ["search", "confirmation"]),
            "start_pose": pd.Categorical.from_codes(of % 3, [f'{{"x": {k}}}' for k in range(3)]),
        }
    )


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    runs_of().to_parquet(folder / WIDE_FILE, index=False)
    return read_run_table(folder)


@pytest.fixture(scope="module")
def facets(table):
    return Facets(table)


def shown(found, name):
    return next(each for each in found["facets"] if each["name"] == name)


def mean_of_configurations(runs):
    return runs.groupby("configuration", observed=True)["passed"].mean().mean()


def test_facet_counts_values_under_conditions_of_other_facets(facets):
    found = shown(facets.json(parse_filter("noise=0.4;family=odd")), "noise")
    runs = runs_of().query("family == 'odd'")
    for each in found["values"]:
        of = runs[runs["noise"] == float(each["value"])]
        own = of["passed"]
        assert (each["passed"], each["failed"]) == (own.eq(True).sum(), own.eq(False).sum())
        assert each["not_judged"] == own.isna().sum()
        assert each["rate"] == pytest.approx(mean_of_configurations(of))


def test_facet_has_rate_of_its_selection_where_value_divides_configurations(facets, table):
    for each in shown(facets.json({}), "purpose")["values"]:
        of = runs_of().query(f"purpose == '{each['value']}'")
        assert each["rate"] == pytest.approx(mean_of_configurations(of))
        chosen = mask_of(table, parse_filter(f"purpose={each['value']}"))
        assert each["rate"] == pytest.approx(summary_json(table, chosen)["rate"])


def test_facet_of_numbers_counts_each_run_once(facets):
    found = shown(facets.json({}), "safety.margin (m)")
    runs = runs_of()
    assert len(found["counts"]) == BINS
    assert np.sum(found["counts"]) + found["missing"] == len(runs)
    assert found["missing"] == runs["safety.margin (m)"].isna().sum()
    assert (found["low"], found["high"]) == (runs["safety.margin (m)"].min(), runs["safety.margin (m)"].max())
    edges = np.linspace(found["low"], found["high"], BINS + 1)
    passed = runs[runs["passed"].eq(True)]["safety.margin (m)"].dropna()
    assert [each[0] for each in found["counts"]] == np.histogram(passed, edges)[0].tolist()


def test_facet_lists_frequent_values_and_counts_omitted_ones(facets):
    found = shown(facets.json(parse_filter("reason=r19")), "reason")
    assert "r19" in [each["value"] for each in found["values"]]
    assert len(found["values"]) + found["left_out"] == runs_of()["reason"].nunique(dropna=False)


def test_facets_name_constant_columns_and_places(facets):
    found = facets.json({})
    assert {"name": "robot", "value": "turtle"} in found["constant"]
    assert found["places"] == ["start_pose"]


def test_summary_counts_runs_and_configurations(table):
    mask = mask_of(table, parse_filter("noise=0.4"))
    found, runs = summary_json(table, mask), runs_of().query("noise == 0.4")
    assert found["runs"] == len(runs)
    assert found["configurations"] == runs["configuration"].nunique()
    assert found["rate"] == pytest.approx(mean_of_configurations(runs)) != pytest.approx(runs["passed"].mean())
    assert found["interval"][0] < found["rate"] < found["interval"][1]


def test_selection_by_verdict_or_metric_is_by_result(table):
    by = {
        text: is_by_result(table, parse_filter(text)) for text in ("noise=0.4;family=odd", "passed=fail", "reason=r19")
    }
    assert by == {"noise=0.4;family=odd": False, "passed=fail": True, "reason=r19": True}


def test_summary_of_no_run_has_no_rate(table):
    found = summary_json(table, np.zeros(len(table), dtype=bool))
    assert (found["runs"], found["rate"], found["interval"]) == (0, None, None)


@pytest.mark.parametrize("descending", [False, True])
@pytest.mark.parametrize("sort", ["rate", "safety.margin (m)", "family"])
def test_rows_are_pages_of_one_order(table, sort, descending):
    mask = np.ones(len(table), dtype=bool)
    pages = [
        rows_json(table, mask, ["noise"], sort, descending=descending, start=start, count=7)["rows"]
        for start in range(0, CONFIGURATIONS, 7)
    ]
    rows = [row for page in pages for row in page]
    assert sorted(row["configuration"] for row in rows) == sorted(table.configurations)
    keys = [row["rate"] if sort == "rate" else row["values"][1] for row in rows]
    assert keys == sorted(keys, reverse=descending)


def test_rows_of_no_run_are_an_empty_page(table):
    found = rows_json(table, np.zeros(len(table), dtype=bool), ["noise"], "family", descending=True, start=0, count=7)
    assert (found["rows"], found["total"]) == ([], 0)


def test_rows_have_means_of_selected_runs(table):
    mask = mask_of(table, parse_filter("passed=pass"))
    runs = runs_of()
    means = runs[runs["passed"].eq(True)].groupby("configuration", observed=True)["safety.margin (m)"].mean()
    found = rows_json(table, mask, ["safety.margin (m)"], "rate", descending=False, start=0, count=100)
    assert {row["configuration"]: row["values"][0] for row in found["rows"]} == pytest.approx(means.to_dict())


def test_points_report_even_sampling(table):
    mask = np.ones(len(table), dtype=bool)
    header, arrays = points(table, mask, ["noise", "family"], 50)
    assert (header["total"], header["shown"]) == (len(table), 50)
    assert header["columns"][1]["levels"] == ["odd", "even"]
    runs = runs_of()
    places, indices = arrays["configuration"], arrays["run"]
    for k in range(50):
        row = runs[(runs["configuration"] == header["configurations"][places[k]]) & (runs["run_index"] == indices[k])]
        assert row["noise"].item() == pytest.approx(arrays["column0"][k])


def test_varying_columns_are_separated_from_constant_ones(table):
    mask = mask_of(table, parse_filter("noise=0.4"))
    assert varying_of(table, mask, ["noise", "path length (m)", "robot"]) == (["path length (m)"], ["noise", "robot"])


def test_reasons_are_counted_with_an_example(table):
    found = reasons_json(table, np.ones(len(table), dtype=bool))
    runs = runs_of()
    counts = runs[runs["passed"].eq(False)]["reason"].value_counts()
    assert found["failed"] == counts.sum()
    assert [each["runs"] for each in found["reason"]["rows"]] == counts.head(12).tolist()
    first = found["reason"]["rows"][0]
    row = runs[(runs["configuration"] == first["configuration"]) & (runs["run_index"] == first["run"])]
    assert row["reason"].item() == first["value"]


def test_neighbor_passes_more_often_and_differs_least(table):
    counts = Chosen(table, np.ones(len(table), dtype=bool)).counts
    rates = counts[:, 0] / counts[:, :2].sum(axis=1)
    worst = int(rates.argmin())
    found = neighbor(table, counts, worst)
    assert found["passes"]
    assert rates[table.configurations.index(found["name"])] == rates.max()
    assert [each["name"] for each in found["differences"] if each["own"] == each["other"]] == []


def test_equal_configurations_have_no_neighbor(table):
    counts = np.tile([[8, 0, 0]], (CONFIGURATIONS, 1))
    assert neighbor(table, counts, 0) is None


@pytest.fixture(scope="module")
def walked(table):
    """Paths of all runs, those of a configuration together, and their grid."""
    grid, rng = grid_over(0.0, 0.0, 12.0, 6.0), np.random.default_rng(6)
    walks = [np.cumsum(np.r_[[[1.0, 3.0]], rng.normal((0.05, 0.0), 0.03, (150, 2))], axis=0) for _ in range(len(table))]
    parts = []
    for first in range(0, len(table), RUNS):
        own = walks[first : first + RUNS]
        starts = np.r_[0, np.cumsum([len(walk) for walk in own])]
        parts.append(paths_of(np.arange(first, first + RUNS), starts, np.concatenate(own), grid))
    return join_paths(parts), grid, walks


def test_paths_keep_ends_and_a_point_for_each_step(walked):
    paths, _, walks = walked
    for k, walk in enumerate(walks):
        line = paths.xy_m[paths.starts[k] : paths.starts[k + 1]]
        assert np.allclose(line[[0, -1]], walk[[0, -1]], atol=1e-5)
        assert np.hypot(*np.diff(line, axis=0).T).max() < 2 * STEP_M


def test_rates_of_cells_are_those_of_the_report(table, walked):
    paths, grid, walks = walked
    mask = mask_of(table, parse_filter("noise=0.4|0.2"))
    header, arrays = layer(paths, table, mask, grid, "rate")
    judged = np.flatnonzero(mask & (table.verdict != 2))
    starts = np.r_[0, np.cumsum([len(walks[k]) for k in judged])]
    expected = failure_map(grid, np.concatenate([walks[k] for k in judged]), starts, table.verdict[judged] == 1)
    assert header["form"] == "grid"
    assert arrays["runs"].tolist() == expected.visits.ravel().tolist()
    assert arrays["failed"].tolist() == expected.failures.ravel().tolist()


def test_lines_are_those_of_selected_runs(table, walked):
    paths, grid, walks = walked
    mask = mask_of(table, parse_filter("passed=fail"))
    header, arrays = layer(paths, table, mask, grid, "paths")
    xy_m, starts, places, indices, verdicts = arrays.values()
    assert header["runs"] == mask.sum() == len(verdicts)
    assert set(verdicts.tolist()) == {1}
    for k, row in enumerate(np.flatnonzero(mask)):
        assert np.allclose(xy_m[starts[k]], walks[row][0], atol=1e-5)
        assert header["configurations"][places[k]] == table.configurations[table.configuration[row]]
        assert indices[k] == table.run_index[row]


def test_paths_become_a_density_beyond_a_number(table, walked, monkeypatch):
    monkeypatch.setattr("vastflow.deployments.explorer.trajectories.MOST_PATHS", 10)
    paths, grid, _ = walked
    header, arrays = layer(paths, table, np.ones(len(table), dtype=bool), grid, "paths")
    assert header["form"] == "grid"
    assert (arrays["failed"] <= arrays["runs"]).all()
    assert arrays["runs"].max() == len(table)  # all begin at one place
