import threading
from collections import deque
from concurrent.futures import Future

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.engine.units import MOST_RUNS, Backlog, Feeder, Units


def configuration(name, family="room", runs=20):
    return ConfigurationRuns(name, family, 1, Scenario("builtin:navigate_to_pose", 60.0, {}, {}, {}), runs)


def backlog(*wanted, **costs_s):
    made = Backlog()
    for configuration, runs in wanted:
        made.add(Units(configuration, list(runs)))
    for family, cost_s in costs_s.items():
        made.took(family, 1, cost_s)
    return made


def taken(backlog, workers):
    while (unit := backlog.take(workers)) is not None:
        yield unit[0].configuration.name, *unit[1:]


@given(st.lists(st.sets(st.integers(0, 60)), max_size=5), st.integers(1, 9), st.sampled_from([None, 0.01, 0.5, 30.0]))
def test_backlog_gives_each_missing_run_once(missing, workers, cost_s):
    wanted = [(configuration(str(k)), deque(sorted(runs))) for k, runs in enumerate(missing) if runs]
    units = list(taken(backlog(*wanted, **({} if cost_s is None else {"room": cost_s})), workers))
    runs = [(name, run) for name, start, stop in units for run in range(start, stop)]
    assert sorted(runs) == sorted((str(k), run) for k, runs in enumerate(missing) for run in runs)
    assert all(stop - start <= MOST_RUNS for _, start, stop in units)


@pytest.mark.parametrize(("cost_s", "sizes"), [(0.01, [20] * 10), (4.0, [5] * 24), (60.0, [1] * 200)])
def test_units_take_seconds(cost_s, sizes):
    wanted = [(configuration(f"{k}"), deque(range(20))) for k in range(10)]
    units = [stop - start for _, start, stop in taken(backlog(*wanted, room=cost_s), 1)]
    assert units[: len(sizes)] == sizes


def test_longest_units_come_first_and_unknown_ones_before():
    wanted = [(configuration(name, name), deque(range(8))) for name in ("short", "long", "unknown")]
    order = [name for name, _, _ in taken(backlog(*wanted, short=0.1, long=2.0), 1)]
    assert list(dict.fromkeys(order)) == ["unknown", "long", "short"]


def test_last_units_are_short():
    units = [stop - start for _, start, stop in taken(backlog((configuration("a"), deque(range(60))), room=1.0), 4)]
    assert units == sorted(units, reverse=True)
    assert units[-8:] == [1] * 8


def test_feeder_keeps_few_units_in_flight():
    futures, fed = [], threading.Semaphore(0)

    def submit(configuration, start, stop):
        futures.append(Future())
        fed.release()
        return futures[-1]

    feeder = Feeder(lambda: 1, submit)
    (units,) = feeder.add([(configuration("a", runs=200), range(200))])
    for _ in range(5):
        assert fed.acquire(timeout=60)
    assert not fed.acquire(timeout=0.2), "the others wait for one that has ended"
    while not units.all_begun:
        next(each for each in futures if not each.done()).set_result(None)
        assert fed.acquire(timeout=60) or units.all_begun
    assert sum(unit.stop - unit.start for unit in units.wait()) == 200


def test_feeder_error_reaches_waiting_stage():
    def submit(configuration, start, stop):
        raise OSError("no file")

    (units,) = Feeder(lambda: 1, submit).add([(configuration("a"), range(3))])
    with pytest.raises(OSError, match="no file"):
        units.wait()


def test_units_are_complete_at_once_where_nothing_is_missing():
    assert Feeder(lambda: 1, lambda *_: Future()).add([(configuration("a"), [])])[0].wait() == []
