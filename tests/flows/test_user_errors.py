"""What a user can mend is of one family, also after it has come from another process."""

import errno
import importlib
import pickle

from table import each_row

from vastflow.sim.model.faults import UserError
from vastflow.tasks.store.store import StoreError

FAMILY = [
    "flows.request.work_pool.WorkPoolError",
    "flows.results.directory.ResultsError",
    "oracles.results.unusable.UnusableDirectory",
    "sim.model.faults.FileError",
    "sim.nav2.parameter_files.document.DocumentError",
    "sim.scenario.language.faults.OscError",
    "tasks.store.artifact.StoreError",
    "tasks.engine.machine_check.MachineError",
]


@each_row("name", FAMILY)
def test_errors_that_end_a_command_with_exit_code_2_are_of_one_family(name):
    module, _, error = f"vastflow.{name}".rpartition(".")
    assert issubclass(getattr(importlib.import_module(module), error), UserError)


def test_prefects_absence_is_no_mistake_of_the_user():
    server, pool = map(importlib.import_module, ("vastflow.tasks.prefect.server", "vastflow.flows.request.work_pool"))
    assert not issubclass(server.PrefectUnavailable, UserError) and not issubclass(pool.WorkersFailed, UserError)


def test_error_of_the_store_keeps_its_words_on_the_path_from_a_worker():
    sent = StoreError("/store: no space left on the device; free some")
    come = pickle.loads(pickle.dumps(sent))
    assert (type(come), str(come)) == (StoreError, str(sent)) and isinstance(come, OSError)
    assert pickle.loads(pickle.dumps(StoreError(errno.ENOSPC, "no space"))).errno == errno.ENOSPC
