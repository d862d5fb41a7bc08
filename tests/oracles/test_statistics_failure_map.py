import numpy as np
import pytest
from table import each_row

from vastflow.oracles.statistics.failure_map import FailureGrid, FailureMap, empty_map, failure_map, grid_over
from vastflow.oracles.statistics.intervals import wilson_intervals

GRID = grid_over(0.0, 0.0, 4.0, 1.0, cell_m=1.0)


def along(*x_m: float) -> np.ndarray:
    return np.array([(x, 0.5) for x in x_m]).reshape(-1, 2)


def mapped(*ways: np.ndarray, failed: list[bool], **given):
    starts = np.r_[0, np.cumsum([len(way) for way in ways])].astype(int)
    return failure_map(GRID, np.concatenate(ways), starts, failed, **given)


def drawn(rng: np.random.Generator, configurations: int, rates: np.ndarray) -> FailureMap:
    """A row of cells with ten visits of each configuration, whose rates are spread around those of the cells."""
    visits = np.full((configurations, 1, len(rates)), 10)
    failures = rng.binomial(10, rng.beta(2 * rates, 2 * (1 - rates), visits.shape))
    squares = np.stack([(failures**2).sum(0), (failures * visits).sum(0), (visits**2).sum(0)])
    came = np.full((1, len(rates)), configurations)
    return FailureMap(FailureGrid((0.0, 0.0), 0.25, came.shape), visits.sum(0), failures.sum(0), came, squares)


def test_run_visits_a_cell_once_however_often_it_comes_back() -> None:
    found = mapped(along(0.2, 0.8, 1.2, 0.8, 0.2, 1.4), failed=[False])
    assert found.visits.tolist() == [[1, 1, 0, 0]]
    assert found.failures.sum() == 0


def test_failed_run_fails_in_the_cells_of_its_last_half_meter() -> None:
    found = mapped(along(0.5, 0.9, 1.3, 1.7, 2.1), along(0.5, 1.5), failed=[True, False])
    assert found.visits.tolist() == [[2, 2, 1, 0]]
    assert found.failures.tolist() == [[0, 1, 1, 0]]


def test_path_and_not_distance_counts_as_the_last_half_meter() -> None:
    found = mapped(along(0.9, 1.1, 1.4, 1.1, 1.4), failed=[True])
    assert found.failures.tolist() == [[0, 1, 0, 0]]


def test_failed_run_that_never_moved_fails_where_it_stood() -> None:
    found = mapped(along(2.5, 2.5, 2.5), failed=[True])
    assert (found.visits.tolist(), found.failures.tolist()) == ([[0, 0, 1, 0]], [[0, 0, 1, 0]])


def test_positions_off_the_grid_and_runs_without_any_are_in_no_cell() -> None:
    found = mapped(along(-0.5, 0.5), along(), along(9.0), failed=[False, True, True])
    assert found.visits.tolist() == [[1, 0, 0, 0]]


def test_cell_of_few_visits_has_no_rate() -> None:
    found = mapped(*[along(0.5)] * 4, along(0.5, 1.5), failed=[True, False, False, False, False])
    assert found.rate(5)[0, 0] == pytest.approx(0.2)
    assert np.isnan(found.rate(5)[0, 1:]).all()


def test_maps_of_configurations_add_up_to_that_of_all() -> None:
    ways = [along(0.5, 1.5), along(0.5), along(0.5, 1.5), along(1.5)]
    failed = [True, False, False, True]
    together = mapped(*ways, failed=failed, configurations=[0, 0, 1, 1])
    added = empty_map(GRID) + mapped(*ways[:2], failed=failed[:2]) + mapped(*ways[2:], failed=failed[2:])
    for name in ("visits", "failures", "configurations", "squares"):
        assert np.array_equal(getattr(added, name), getattr(together, name))


def test_intervals_have_configurations_as_clusters() -> None:
    failures, visits = [3, 0, 4, 1], [5, 5, 5, 4]
    ways = [along(0.5)] * sum(visits)
    failed = [k < f for f, v in zip(failures, visits, strict=True) for k in range(v)]
    found = mapped(*ways, failed=failed, configurations=np.repeat(np.arange(4), visits))
    # p = 8/19, x - p n = 17/19, -40/19, 36/19, -13/19: V = 4/3 · 3354/19² / 19² = 0.034315, so p(1 - p)/V = 7.1034 visits;
    # t with 3 degrees of freedom is 3.182446.
    effective = 7.1034 * (1.959964 / 3.182446) ** 2
    assert found.intervals()[0, 0] == pytest.approx(wilson_intervals(8 / 19 * effective, effective), abs=1e-4)


def test_one_configuration_counts_as_one_observation() -> None:
    found = mapped(*[along(0.5)] * 20, failed=[True] * 20)
    assert found.intervals()[0, 0] == pytest.approx(wilson_intervals(1, 1))
    assert found.intervals()[0, 3] == pytest.approx([0.0, 1.0])


def test_planted_hot_cell_is_found_and_no_other() -> None:
    rng = np.random.default_rng(2)
    found = empty_map(GRID)
    for _ in range(60):
        bad = rng.random(10) < 0.4
        ways = [along(0.5, 1.5, 2.5) if fails else along(0.5, 1.5, 2.5, 3.5) for fails in bad]
        found += mapped(*ways, failed=bad.tolist())
    assert found.hot().tolist() == [[False, False, True, False]]


@each_row("configurations", [1, 2, 3, 5, 12])
def test_cells_that_fail_like_all_others_are_not_marked_however_few_came_by(configurations: int) -> None:
    # Configurations differ much: rates from B(0.4, 1.6), mean 0.2. The same in every cell, so each mark is a false one.
    rng = np.random.default_rng(3)
    marked = sum(drawn(rng, configurations, np.full(200, 0.2)).hot().any() for _ in range(100))
    assert marked / 100 <= 0.05 + 4 * (0.05 * 0.95 / 100) ** 0.5


def test_cells_that_fail_more_are_marked_once_enough_configurations_came_by() -> None:
    rng = np.random.default_rng(3)
    rates = np.r_[np.full(10, 0.8), np.full(190, 0.1)]
    hot = drawn(rng, 20, rates).hot().ravel()
    assert hot[:10].mean() >= 0.9
    assert hot[10:].sum() <= 1


def test_without_a_failure_nothing_is_hot() -> None:
    assert not mapped(*[along(0.5)] * 9, failed=[False] * 9).hot().any()
    assert not empty_map(GRID).hot().any()


def test_maps_of_different_grids_are_not_added() -> None:
    with pytest.raises(ValueError, match="expected maps of one grid"):
        _ = empty_map(GRID) + empty_map(grid_over(0, 0, 1, 1))


def test_starts_that_do_not_fit_the_positions_are_refused() -> None:
    with pytest.raises(ValueError, match="starts must rise from 0 to 2 in 2 steps"):
        failure_map(GRID, along(0.5, 1.5), [0, 3], [False])


def test_grid_covers_the_rectangle() -> None:
    assert grid_over(-1.0, 2.0, 1.1, 3.0, cell_m=0.5).shape == (2, 5)
    assert grid_over(-1.0, 2.0, 1.1, 3.0, cell_m=0.5).extent_m == (-1.0, 1.5, 2.0, 3.0)
