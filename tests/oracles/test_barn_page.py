"""The page of BARN's results, from tables of a few runs."""

import json
from pathlib import Path

import pandas as pd
import pytest
from barn_page import OWN, barn_page, correlations, mean_over_worlds, published_runs, runs_of

from vastflow.flows.cli.barn import barn_worlds
from vastflow.oracles.statistics.intervals import clustered_interval

BENCHMARK = Path(__file__).parents[3] / "shared" / "upstream" / "barn"
ENDS = ("arrived", "collided", "timed_out")
SPEEDS = ({"FollowPath.vx_max": 0.5}, {"FollowPath.max_vel_x": 2.0, "FollowPath.max_speed_xy": 2.0})


def ran(world, end, time_s, score=0.0, **others):
    """A row of `runs_wide.parquet`; an `end` of None is a run that was not judged."""
    metrics = {f"barn.{name}": None if end is None else float(name == end) for name in ENDS}
    scores = {"barn.score_2_8": score, "barn.score_4_8": score / 2} if end else {}
    return {"world": f"world_{world}", **metrics, "barn.time (s)": time_s, **scores, **others}


RUNS = [
    ran(0, "arrived", 20.0, 0.3),
    ran(0, "arrived", 30.0, 0.2),
    ran(6, "collided", 5.0),
    ran(6, "arrived", 40.0, 0.1),
    ran(12, "timed_out", 100.0),
    ran(12, None, None),
]


@pytest.fixture
def directory(tmp_path):
    """Writes the tables of a campaign directory, whose runs take 1, 2, … CPU-seconds."""

    def write(rows):
        rows = [{"configuration": f"barn-{k}", "run_index": 0, **row} for k, row in enumerate(rows)]
        pd.DataFrame(rows).to_parquet(tmp_path / "runs_wide.parquet")
        logs = [{"configuration": f"barn-{k}", "runs": [{"run_index": 0, "cpu_s": k + 1.0}]} for k in range(len(rows))]
        (tmp_path / "logs").mkdir(exist_ok=True)
        (tmp_path / "logs" / "runs.jsonl").write_text("".join(json.dumps(row) + "\n" for row in reversed(logs)))
        return tmp_path

    return write


def table(page):
    """The cells of each row of the page's tables, by its first cell."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line.startswith("|")]
    return {first: others for first, *others in reversed(rows)}


def test_means_are_those_of_worlds_and_times_those_of_arrivals(directory):
    (runs,) = runs_of(directory(RUNS)).values()
    found = {column: mean_over_worlds(runs, column) for column in runs.columns.drop("world")}
    assert {column: mean.value for column, mean in found.items()} == pytest.approx(
        {
            "arrived": (1 + 1 / 2 + 0) / 3,
            "collided": 1 / 6,
            "timed_out": 1 / 3,
            "time": (25 + 40) / 2,
            "score_2_8": (0.25 + 0.05 + 0) / 3,
            "score_4_8": (0.125 + 0.025 + 0) / 3,
            "cpu_s": 3.5,
        }
    )
    of_worlds = clustered_interval([2, 1, 0], [2, 2, 1])
    assert found["arrived"][1:] == (of_worlds.low, of_worlds.high)
    # Student's of two worlds: 12.706 standard errors of 7.5 s.
    assert found["time"][1:] == pytest.approx((32.5 - 12.706 * 7.5, 32.5 + 12.706 * 7.5), abs=0.01)


def test_controllers_differ_by_kind_and_speed(directory):
    kinds = ("mppi", "dwb")
    rows = [{**row, "controller": kind, **speed} for kind, speed in zip(kinds, SPEEDS, strict=True) for row in RUNS[:4]]
    found = runs_of(directory(rows))
    assert [*found] == ["MPPI 0.5 m/s", "DWB 2 m/s"]
    assert found["DWB 2 m/s"]["cpu_s"].tolist() == [5.0, 6.0, 7.0, 8.0]
    assert [*runs_of(directory(RUNS))] == [OWN]


def published(times_s):
    """Two runs of each world, of which the second failed in the worlds that took longest."""
    rows = [(6 * k, run, time_s) for k, time_s in enumerate(times_s) for run in (0, 1)]
    return pd.DataFrame(
        {"world": world, "arrived": float(not run or time_s < 40), "time": time_s} for world, run, time_s in rows
    )


def test_correlation_is_that_of_ranks_over_shared_worlds():
    easy_first, times_s = published([20, 30, 40, 50, 60]), [20, 22, 47, 46, 90]
    found, worlds = correlations(easy_first, published(times_s))["time"]
    assert (found.value, worlds) == (pytest.approx(0.9), 5)
    # Half the width of Fisher's z is 1.96 √((1 + 0.9² / 2) / 2).
    assert (found.low, found.high) == pytest.approx((-0.1689, 0.9961), abs=1e-4)
    assert correlations(easy_first, published(times_s[:4]))["failures"][0].value == pytest.approx(1.0)
    assert correlations(easy_first, published([20, 30, 35]))["failures"] == (None, 3)


def test_page_has_both_sets_of_runs_and_says_how_many_were_not_judged(directory):
    own = runs_of(directory(RUNS))
    twice = pd.concat([own[OWN], own[OWN]]).assign(cpu_s=[9.9, *[0.6] * 11])  # the first has compiled
    page = barn_page({"RPP 2 m/s": twice}, own, None, (0.05, 0.06))
    rows = table(page)
    assert rows["RPP 2 m/s"][:2] == ["3", "12"]
    assert rows[OWN][2].startswith("0.500 [")
    assert rows["RPP 2 m/s"][-1] == "0.60 [0.60, 0.60]"
    assert "500 runs of RPP 2 m/s take 5.0 CPU-minutes" in " ".join(page.split())
    assert f"{OWN}: 1 of 6 runs were not judged" in page
    assert "12 (1.0), 6 (0.5)" in page
    assert "Spearman" not in page
    assert page == barn_page({"RPP 2 m/s": twice}, own, None, (0.05, 0.06))


def test_published_runs_of_dwa_have_the_published_figures(directory):
    if not BENCHMARK.is_dir():
        pytest.skip("the benchmark's data is not here")
    lengths_m = {number: world.length_m for number, world in barn_worlds(BENCHMARK, 6).items()}
    runs = published_runs(BENCHMARK / "dwa_out.txt", lengths_m)
    columns = (*ENDS, "time", "score_2_8", "score_4_8")
    means = [mean_over_worlds(runs, column).value for column in columns]
    said = [0.850, 0.056, 0.094, 34.09, 0.1592, 0.1580]
    assert means == pytest.approx(said, rel=5e-4)
    own = runs_of(directory(RUNS))
    with_file, without = (table(barn_page(own, own, each, (0.05, 0.06))) for each in (runs, None))
    name = "move_base DWA, 0.5 m/s, ROS 1"
    assert [cell.split(" [")[0] for cell in with_file[name][:-1]] == without[name][:-1]
