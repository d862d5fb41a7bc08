import os
import signal
import subprocess
import sys
import textwrap
import time

import cloudpickle
import psutil
import pytest

from vastflow.tasks.engine import pool as pool_module
from vastflow.tasks.engine.executor import PoolClosed, Priority, WorkerDied
from vastflow.tasks.engine.pool import MANY, Pool

pytestmark = pytest.mark.timeout(900)

# Workers can't import a test module, so what is submitted from here goes to them by value.
cloudpickle.register_pickle_by_value(sys.modules[__name__])


@pytest.fixture
def pool():
    made = Pool(2)
    yield made
    made.close()


def square(x):
    return x * x


def process_of(took_s):
    time.sleep(took_s)
    return os.getpid()


def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(mark):
    if not mark.exists():
        mark.touch()
        die()
    return "done"


def wait_for(file, log, name):
    deadline = time.monotonic() + 200
    while not file.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    with open(log, "a") as out:
        out.write(f"{name}\n")


def meet(folder, own, other):
    """Whether another job runs at the same time as this one."""
    (folder / own).touch()
    deadline = time.monotonic() + 100
    while not (folder / other).exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    return (folder / other).exists()


def append(log, name):
    with open(log, "a") as out:
        out.write(f"{name}\n")


def test_job_returns_result(pool):
    assert pool.submit(square, 7, priority=Priority.EXECUTE).result(120) == 49


def test_exception_of_a_job_reaches_the_caller(pool):
    with pytest.raises(ZeroDivisionError, match="division"):
        pool.submit(divmod, 1, 0, priority=Priority.EXECUTE).result(120)


def test_judgment_overtakes_executions_that_wait(tmp_path):
    pool = Pool(1)
    try:
        log, gate = tmp_path / "log", tmp_path / "gate"
        first = [
            pool.submit(wait_for, gate, log, "execute", priority=Priority.EXECUTE) for _ in range(2)
        ]  # fill the pool
        later = [pool.submit(append, log, "execute", priority=Priority.EXECUTE) for _ in range(3)]
        judge = pool.submit(append, log, "judge", priority=Priority.JUDGE)
        gate.touch()
        for future in [*first, *later, judge]:
            future.result(120)
        assert log.read_text().split() == ["execute", "execute", "judge", "execute", "execute", "execute"]
    finally:
        pool.close()


def test_few_short_jobs_are_done_by_one_worker(pool):
    assert len({pool.submit(os.getpid, priority=Priority.EXECUTE).result(120) for _ in range(5)}) == 1


def test_long_jobs_get_a_worker_each(pool, tmp_path, monkeypatch):
    monkeypatch.setattr(pool_module, "WAITS_S", 1.0)
    jobs = [
        pool.submit(meet, tmp_path, each, other, priority=Priority.EXECUTE) for each, other in (("a", "b"), ("b", "a"))
    ]
    assert [job.result(120) for job in jobs] == [True, True]


def test_pool_starts_all_workers_for_many_jobs(tmp_path, monkeypatch):
    monkeypatch.setattr(pool_module, "WAITS_S", 1000.0)
    pool = Pool(2)
    try:
        met = [
            pool.submit(meet, tmp_path, each, other, priority=Priority.JUDGE)
            for each, other in (("a", "b"), ("b", "a"))
        ]
        rest = [pool.submit(square, x, priority=Priority.EXECUTE) for x in range(MANY * 2)]
        assert [job.result(120) for job in met] == [True, True]
        assert [job.result(120) for job in rest] == [x * x for x in range(MANY * 2)]
    finally:
        pool.close()


def test_pool_keeps_one_worker_for_many_judgings(tmp_path, monkeypatch):
    monkeypatch.setattr(pool_module, "WAITS_S", 1000.0)
    pool = Pool(2)
    try:
        jobs = [pool.submit(process_of, 0.05, priority=Priority.JUDGE) for _ in range(MANY * 8)]
        assert len({job.result(120) for job in jobs}) == 1
    finally:
        pool.close()


def test_killed_workers_job_is_retried_elsewhere(pool, tmp_path):
    assert pool.submit(die_once, tmp_path / "mark", priority=Priority.EXECUTE).result(120) == "done"


def test_job_that_kills_every_worker_fails_alone(pool):
    poison = pool.submit(die, priority=Priority.EXECUTE)
    others = [pool.submit(square, i, priority=Priority.EXECUTE) for i in range(20)]
    assert [future.result(120) for future in others] == [i * i for i in range(20)]
    with pytest.raises(WorkerDied, match="died 3 times"):
        poison.result(120)


def test_closing_ends_waiting_and_running_jobs_at_once(tmp_path):
    pool = Pool(1)
    running = pool.submit(wait_for, tmp_path / "never", tmp_path / "log", "late", priority=Priority.EXECUTE)
    waiting = [pool.submit(square, i, priority=Priority.EXECUTE) for i in range(5)]
    time.sleep(1.0)
    pool.close()
    assert not (tmp_path / "log").exists()
    for future in [running, *waiting]:
        with pytest.raises(PoolClosed):
            future.result(60)


def test_closing_leaves_no_worker():
    pool = Pool(2)
    workers = {pool.submit(os.getpid, priority=Priority.EXECUTE).result(120) for _ in range(4)}
    pool.close()
    until_ended(workers)


def test_job_for_a_closed_pool_ends_at_once():
    pool = Pool(1)
    pool.close()
    with pytest.raises(PoolClosed):
        pool.submit(square, 2, priority=Priority.JUDGE).result(60)


def test_workers_end_with_a_killed_parent(tmp_path):
    script = tmp_path / "script.py"  # without a __main__ guard
    script.write_text(
        textwrap.dedent("""
        import os, time
        from vastflow.tasks.engine.executor import Priority
        from vastflow.tasks.engine.pool import Pool
        pool = Pool(2)
        print(*{pool.submit(os.getpid, priority=Priority.EXECUTE).result(120) for _ in range(4)}, flush=True)
        time.sleep(600)
        """)
    )
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    try:
        workers = [int(pid) for pid in parent.stdout.readline().split()]
    finally:
        parent.kill()
        parent.wait()
    assert workers
    until_ended(workers)


def until_ended(workers):
    deadline = time.monotonic() + 60
    while any(map(_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(_alive, workers))


def test_output_of_a_worker_goes_to_the_log(tmp_path):
    log = tmp_path / "log"
    pool = Pool(1, log)
    try:
        pool.submit(_say, "hello from a worker", priority=Priority.EXECUTE).result(120)
    finally:
        pool.close()
    assert "hello from a worker" in log.read_text()


def test_workers_do_not_import_prefect(pool):
    assert pool.submit(_loaded, "prefect", priority=Priority.EXECUTE).result(120) is False


def _say(text):
    print(text, flush=True)


def _loaded(module):
    return module in sys.modules


def _alive(pid):
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_bounded_pool_goes_on_with_fewer_processes(tmp_path):
    pool = Pool(3)
    try:
        pairs = [pool.submit(meet, tmp_path, *names, priority=Priority.EXECUTE) for names in ("ab", "ba")]
        others = [pool.submit(process_of, 0.0, priority=Priority.EXECUTE) for _ in range(MANY * 3)]
        assert all(each.result() for each in pairs) and all(each.result() for each in others)
        pool.bound(5)
        assert pool.workers == 3
        pool.bound(1)
        after = [pool.submit(process_of, 0.01, priority=Priority.EXECUTE) for _ in range(MANY * 3)]
        assert (pool.workers, len({each.result() for each in after})) == (1, 1)
    finally:
        pool.close()
