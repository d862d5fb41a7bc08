"""The executor of a Dask cluster, whose scheduler and worker are threads of this process."""

import os
import pickle
import re
import threading
import time

import distributed
import pytest
from at_once import AtOnce
from dask import config
from distributed.comm import CommClosedError
from distributed.core import Status
from distributed.security import Security

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.plug_ins.effects import Interrupted
from vastflow.tasks.engine import dask_cluster, dask_worker
from vastflow.tasks.engine.dask_cluster import DaskCluster
from vastflow.tasks.engine.dask_worker import Answer, OtherCode, write_answer
from vastflow.tasks.engine.executor import ClusterError, PoolClosed, Priority
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.work import answered
from vastflow.tasks.store.store import StoreError, open_store

pytestmark = pytest.mark.timeout(120)


@pytest.fixture(scope="module")
def dask():
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, protocol="tcp", dashboard_address=":0", memory_limit=0
    ) as made:
        yield made


class Here(AtOnce):
    """Executes at once, and keeps what it was asked for."""

    def __init__(self):
        self.done = []

    def called(self, function, *arguments):
        self.done.append(function)
        return function(*arguments)

    def rest(self):
        self.done.append("rest")

    def close(self):
        self.done.append("close")


class Told(Tally):
    """Keeps notices as they come."""

    def __init__(self):
        super().__init__()
        self.told = []

    def notice(self, line):
        self.told.append(line)


@pytest.fixture
def opened(dask, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(dask_cluster, "_END_S", 1.0)
    made = []

    def executor(address=dask.scheduler_address):
        tally = Told()
        made.append(DaskCluster(address, open_store(tmp_path / "store"), Here(), tally))
        made[-1].notices, made[-1].tally = tally.told, tally
        return made[-1]

    yield executor
    for each in made:
        each.close()


def execute(executor, function, *arguments):
    return executor.submit(function, *arguments, priority=Priority.EXECUTE)


def test_table_of_workers_begins_with_longest_busy(opened, tmp_path):
    executor, ready = opened(), tmp_path / "ready"
    unit = execute(executor, _wait_for, str(ready))
    while not (rows := executor.workers_table()) or rows[0]["busy for"] in ("–", "0 s"):
        time.sleep(0.2)
    (row,) = rows
    assert row["state"] == "running" and row["memory"].endswith(" MiB") and row["heard"].endswith(" s ago")
    assert re.fullmatch(r"\d+ s", row["busy for"])
    ready.touch()
    assert unit.result(60) is None
    executor.close()
    assert executor.workers_table() == []


def test_cluster_with_tls_takes_certificates_from_dasks_configuration(opened):
    made = Security.temporary()
    files = {"ca-file": made.tls_ca_file, "client.cert": made.tls_client_cert, "client.key": made.tls_client_key}
    with distributed.LocalCluster(
        n_workers=1, security=made, processes=False, protocol="tls", dashboard_address=":0", memory_limit=0
    ) as cluster:
        assert cluster.scheduler_address.startswith("tls://")
        with config.set({f"distributed.comm.tls.{name}": content for name, content in files.items()}):
            assert execute(opened(cluster.scheduler_address), divmod, 17, 5).result(60) == [3, 2]


def test_cluster_gives_results_and_errors(opened):
    executor = opened()
    futures = [execute(executor, divmod, 17, k) for k in range(1, 30)]
    assert [future.result(60) for future in futures] == [[*divmod(17, k)] for k in range(1, 30)]
    assert execute(executor, divmod, 1, 0).result(60).error == "ZeroDivisionError: integer division or modulo by zero"
    with pytest.raises(StoreError, match=r"^on \S+: store: the disk is full$"):
        execute(executor, _full).result(60)
    assert executor.workers == 2


def _full():
    raise StoreError("store: the disk is full")


def test_worker_without_writable_cache_ends_everything(opened, tmp_path, monkeypatch):
    executor = opened()
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    with pytest.raises(StoreError, match=r"^on \S+: can't write to '/dev/null/vastflow' .* Set XDG_CACHE_HOME to"):
        execute(executor, len, "ab").result(60)


def test_units_have_store_of_their_worker_and_shared_values(opened):
    executor = opened()
    store, shared = executor._packer._store, executor.shared((1, store_of(executor)))
    assert execute(executor, _put, store, shared).result(60) == [1, str(store.place)]
    assert store.find("observe/ab/key") is not None


def store_of(executor):
    return executor._packer._store


def _put(store, shared):
    number, same = shared()
    store.put("observe/ab/key", {"x": b"x"})
    return number, same.place


def test_producers_are_evaluated_on_this_machine(opened):
    executor = opened()
    assert executor.submit(os.getpid, priority=Priority.EVALUATE).result(60) == os.getpid()
    executor.rest()
    assert executor._local.done == [os.getpid, "rest"]


def test_preparation_is_called_once_before_the_units(opened, tmp_path):
    executor, log = opened(), str(tmp_path / "log")
    assert executor.prepare(_note, log, "prepared").result(60) is None
    units = [execute(executor, _note, log, "unit") for _ in range(3)]
    assert [unit.result(60) for unit in units] == [None] * 3
    with open(log) as file:
        assert file.read().split() == ["prepared", "unit", "unit", "unit"]


def test_scheduler_keeps_no_plug_in_of_the_campaign(opened, dask):
    executor = opened()
    executor.prepare(len, "ab")
    assert execute(executor, len, "ab").result(60) == 2
    assert dask.scheduler.worker_plugins.keys() == {"shuffle"}


def _note(log, word):
    with open(log, "a") as file:
        file.write(f"{word} ")


def test_file_that_cannot_be_sent_is_error_of_its_unit(opened, tmp_path):
    from vastflow.sim.model.digest import FileContent

    executor = opened()
    with pytest.raises(ScenarioError, match=r"No such file.*workers elsewhere need it"):
        execute(executor, len, [FileContent(str(tmp_path / "gone.yaml"), "d")]).result(60)
    assert execute(executor, len, "ab").result(60) == 2


def test_closing_ends_open_units_and_interrupts_running_ones(opened, tmp_path):
    executor, mark = opened(), tmp_path / "mark"
    running = [execute(executor, _last, str(mark)) for _ in range(4)]
    while not mark.exists():
        time.sleep(0.02)
    executor.close()
    for each in running:
        with pytest.raises(PoolClosed):
            each.result(10)
    until_same(lambda: mark.stat().st_size)
    with pytest.raises(PoolClosed):
        execute(executor, len, "ab").result(10)


def until_same(seen):
    """Wait until two looks 2 s apart see the same; units that go on would write meanwhile."""
    while seen() != (time.sleep(2.0) or seen()):
        pass


def _last(mark):
    while True:
        with open(mark, "a") as file:
            file.write(".")
        time.sleep(0.02)


def test_worker_with_other_code_is_refused_with_both_digests(opened, monkeypatch):
    def code():
        return ("b" * 64 if threading.current_thread().name.startswith("vastflow") else "a" * 64), None

    monkeypatch.setattr(dask_worker, "own_code", code)
    with pytest.raises(ClusterError, match=r"has other code \(a{12}\) than this campaign \(b{12}\)"):
        execute(opened(), len, "ab").result(60)


def test_late_worker_with_other_code_gives_one_notice(opened, monkeypatch):
    executor, retired = opened(), []
    unit = execute(executor, time.sleep, 2.0)
    while executor._client is None:
        time.sleep(0.05)
    monkeypatch.setattr(executor._client, "retire_workers", lambda workers, **_: retired.append(workers))
    (job,) = executor._open.values()
    for _ in range(3):
        executor._take_one(job, write_answer(Answer(other=OtherCode("tcp://late", "a" * 64))), None)
    assert unit.result(60) is None
    (said,) = [each for each in executor.notices if "other code" in each]
    assert said.startswith("worker tcp://late has other code (aaaaaaaaaaaa)") and retired == [["tcp://late"]] * 3


def test_silent_worker_is_left_to_scheduler(opened, monkeypatch):
    dead = pickle.dumps(CommClosedError("in <TCP (closed)>: Stream is closed")).decode("latin-1")
    monkeypatch.setattr(dask_cluster, "call_workers", lambda client, function: {"tcp://dead": dead})
    assert execute(opened(), len, "ab").result(60) == 2


def test_unusable_address_is_refused_at_once(opened):
    executor = opened("tls://127.0.0.1:9")
    with pytest.raises(
        ClusterError, match=r"^--cluster: 'tls://127\.0\.0\.1:9' can't be used \(TypeError: TLS expects"
    ):
        execute(executor, len, "ab").result(60)
    assert executor.notices == []


def test_scheduler_file_with_something_else_is_refused_at_once(opened, tmp_path):
    (tmp_path / "README.md").write_text("# no scheduler file")
    with pytest.raises(ClusterError, match=r"expected a file that a scheduler of Dask wrote, got .*README\.md"):
        execute(opened(str(tmp_path / "README.md")), len, "ab").result(60)


def test_scheduler_that_stays_away_ends_everything(opened, monkeypatch):
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.2)
    monkeypatch.setattr(dask_cluster, "AWAY_S", 4.0)
    executor = opened("tcp://127.0.0.1:9")
    with pytest.raises(ClusterError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:9'.* within 4 s"):
        execute(executor, len, "ab").result(60)
    assert len(executor.notices) == 1
    with pytest.raises(ClusterError):
        execute(executor, len, "ab").result(60)


def test_closing_while_scheduler_is_away_prints_no_traceback(opened, caplog):
    with distributed.LocalCluster(
        n_workers=1, processes=False, protocol="tcp", dashboard_address=":0", memory_limit=0
    ) as cluster:
        executor = opened(cluster.scheduler_address)
        assert execute(executor, len, "ab").result(60) == 2
    while executor._client.status != "connecting":
        time.sleep(0.05)
    time.sleep(0.5)
    executor.close()
    time.sleep(0.5)
    assert not [each for each in caplog.records if each.name == dask_cluster._DASK.name]
    assert dask_cluster._DASK.level == executor._level


def test_answers_of_lost_connection_are_not_taken(opened, monkeypatch):
    executor, quietly = opened(), dask_cluster._quietly
    unit = execute(executor, time.sleep, 4.0)
    while (first := executor._client) is None:
        time.sleep(0.05)
    monkeypatch.setattr(dask_cluster, "_quietly", lambda call: (time.sleep(1.5), quietly(call)))
    executor._lost(first)
    while (second := executor._client) is None:
        time.sleep(0.05)
    assert unit.result(60) is None
    assert executor._client is second is not first


def _busy(spent):
    if spent.exists():
        return
    spent.touch()
    began_s = time.process_time()
    while time.process_time() - began_s < 0.3:
        pass


@pytest.mark.parametrize("before", [False, True])
def test_cpu_time_of_workers_elsewhere_includes_their_preparation(opened, tmp_path, before):
    executor = opened()
    if before:
        executor.prepare(_busy, tmp_path / "spent")
    execute(executor, _busy, tmp_path / "spent").result(60)
    assert 0.2 < executor.tally.elsewhere_cpu_s < 30.0


@pytest.mark.slow
@pytest.mark.timeout(580)
def test_local_cluster_whose_scheduler_died_is_started_again(opened):
    executor = opened("local:1")
    assert execute(executor, len, "ab").result(250) == 2
    executor._own._process.kill()
    assert execute(executor, len, "abc").result(250) == 3


def test_cluster_without_worker_prints_command_during_instantiation_and_waits(opened, monkeypatch):
    monkeypatch.setattr(dask_cluster, "NO_WORKER_S", 1000.0)  # of workers that were there
    with distributed.LocalCluster(n_workers=0, processes=False, protocol="tcp", dashboard_address=":0") as empty:
        executor = opened(empty.scheduler_address)
        assert executor.submit(len, "a", priority=Priority.EVALUATE).result(0) == 1
        while len(executor.notices) < 2:
            time.sleep(0.05)
        assert executor.notices[0] == f"Dask's dashboard: {executor._client.dashboard_link}"
        assert executor.notices[1].startswith(f"no worker at {empty.scheduler_address}. Start one, unless some are")
        unit = execute(executor, len, "ab")
        empty.scale(1)
        assert unit.result(60) == 2
        executor.close()


def test_units_that_wait_on_paused_worker_go_to_another(opened, monkeypatch):
    monkeypatch.setattr(dask_cluster, "NO_WORKER_S", 0.1)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=":0", memory_limit=0
    ) as cluster:
        executor = opened(cluster.scheduler_address)
        units = [execute(executor, time.sleep, 0.5) for _ in range(8)]
        while not any(unit.done() for unit in units):
            time.sleep(0.02)
        one, other = cluster.workers.values()
        set_status(one, Status.paused)
        assert [unit.result(60) for unit in units] == [None] * 8
        while executor.workers != 1:
            time.sleep(0.05)
        set_status(other, Status.paused)
        late = execute(executor, len, "ab")
        while not (said := [each for each in executor.notices if "paused" in each]):
            time.sleep(0.05)
        assert said[0].startswith(f"all workers at {cluster.scheduler_address} (2) are paused by Dask")
        set_status(one, Status.running)
        assert late.result(60) == 2
        executor.close()


def set_status(worker, status):
    worker.loop.add_callback(setattr, worker, "status", status)


def test_canceled_unit_is_interrupted_once(opened, tmp_path):
    executor, log = opened(), tmp_path / "log"
    assert execute(executor, len, "ab").result(60) == 2
    execute(executor, _stubborn, str(log))
    while not (log.exists() and log.read_text()):
        time.sleep(0.02)
    executor.close()
    while "end" not in log.read_text():
        time.sleep(0.05)
    assert log.read_text().split() == ["begin", "interrupted", "end"]


def _stubborn(log):
    """Work on for a while after an interrupt."""
    _note(log, "begin")
    for word in ("interrupted", "end"):
        try:
            for _ in range(40):
                time.sleep(0.05)
        except Interrupted:
            pass
        _note(log, word)


def test_unit_of_closed_executor_ends_between_two_runs(opened, tmp_path):
    executor = opened()
    execute(executor, _runs, tmp_path)
    while not (tmp_path / "0").exists():
        time.sleep(0.02)
    executor.close()
    until_same(lambda: len(list(tmp_path.iterdir())))
    assert not (tmp_path / "99").exists()


def _runs(folder):
    for run in range(100):
        (folder / f"{run}").touch()
        answered(_rest)


def _rest():
    for _ in range(20):
        time.sleep(0.01)


def test_canceled_unit_never_begins(opened, tmp_path):
    executor, ready = opened(), tmp_path / "ready"
    gate = [execute(executor, _wait_for, str(ready)) for _ in range(2)]
    late = [execute(executor, len, "ab") for _ in range(8)]
    while not all(each.future for each in executor._open.values()):
        time.sleep(0.02)
    client = executor._client
    assert late[-1].cancel()
    ready.touch()
    assert [each.result(60) for each in (*gate, *late[:-1])] == [None] * 2 + [2] * 7
    assert late[-1].cancelled() and not executor._open
    assert executor._client is client, "a canceled unit is no lost scheduler"


def test_unit_canceled_before_its_thread_never_begins(opened, dask, tmp_path):
    executor, (worker,), ready = opened(), dask.workers.values(), threading.Event()
    assert execute(executor, len, "ab").result(60) == 2
    for _ in range(2):
        worker.executors["default"].submit(ready.wait)
    execute(executor, _note, str(tmp_path / "log"), "begun")
    for state, then in (("executing", executor.close), ("cancelled", ready.set)):
        while state not in {each.state for each in [*worker.state.tasks.values()]}:
            time.sleep(0.02)
        then()
    while worker.state.tasks:
        time.sleep(0.02)
    assert not (tmp_path / "log").exists()


def _wait_for(file):
    while not os.path.exists(file):
        time.sleep(0.05)
