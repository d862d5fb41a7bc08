"""The log of a run as plain values."""

import json

import pytest
from table import each_row

from vastflow.sim.model.runlog import LogText, RunLog, Use, run_log_of, run_log_row

LOG = RunLog(
    *(1_700_000_000.25, 2.5, 1.25, 4096, ("0.1 s: begun",)),
    texts=(LogText("map", ("map_server", "-v"), "ready\n", False),),
    resources=(Use(0.0, 0.0, 1024, 1), Use(1.0, 0.5, 2048, 2)),
    notes=("big.bin is not kept",),
)


@each_row("log", [LOG, RunLog(0.0, 0.5, 0.25, 1000)])
def test_log_comes_back_from_json_as_it_was(log):
    assert run_log_of(json.loads(json.dumps(run_log_row(log)))) == log


def test_row_with_other_keys_is_no_log():
    with pytest.raises(KeyError, match="wall_s"):
        run_log_of({key: value for key, value in run_log_row(LOG).items() if key != "wall_s"})
