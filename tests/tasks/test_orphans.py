"""Flow runs whose process is gone: found by their tags."""

import subprocess
import sys

import psutil
from prefect import tags
from prefect.context import TagsContext

from vastflow.tasks.prefect.orphans import is_orphan, process_tags, tagged, untagged


def test_flow_run_is_an_orphan_if_its_process_on_this_host_is_gone():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    host, own = process_tags()
    process = psutil.Process()
    later = f"process:{process.pid}@{int(process.create_time()) - 60}"  # another process of the same number
    assert is_orphan([host, f"process:{ended.pid}@1", "vastflow"]) and is_orphan([host, later])
    for names in (["vastflow", host, own], ["host:elsewhere/1", "process:1@1"], ["vastflow"]):
        assert not is_orphan(names)


def test_flow_runs_have_the_tags_of_their_process_and_task_runs_do_not():
    with tags("mine"), tagged():
        assert TagsContext.get().current_tags == {"mine", *process_tags()}
        with untagged():
            assert TagsContext.get().current_tags == {"mine"}
