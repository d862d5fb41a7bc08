"""The process of a campaign: interrupts, its end, its garbage collection, and its memory."""

import asyncio
import gc
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import pytest

from vastflow.tasks.engine.process import cpu_s, few_collections, owns_process, terminable

pytestmark = pytest.mark.timeout(900)


def test_sigterm_interrupts_as_ctrl_c_does():
    with pytest.raises(KeyboardInterrupt), terminable():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_cpu_time_of_children_counts_once_while_and_after_they_live():
    burn = "import time\nwhile time.process_time() < 0.5: pass\nprint(flush=True); input()"
    before_s = cpu_s()
    with subprocess.Popen([sys.executable, "-c", burn], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        child.stdout.readline()
        alive_s = cpu_s() - before_s
        child.communicate(b"\n")
    ended_s = cpu_s() - before_s
    assert alive_s >= 0.45
    assert alive_s - 1e-6 <= ended_s < alive_s + 0.4  # differences of greater numbers, which round


def test_program_keeps_its_own_handler_of_sigterm():
    heard = []
    signal.signal(signal.SIGTERM, lambda *_: heard.append(1))
    try:
        with terminable():
            os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    assert heard == [1]


def test_process_that_does_not_end_is_ended_with_code_130_after_the_kill():
    script = textwrap.dedent("""
        import threading
        from vastflow.tasks.engine import process as ending
        ending.BOUND_S = 0.2
        ending.bound(lambda: print("killed", flush=True))
        threading.Event().wait()
    """)
    done = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True, timeout=240)
    assert (done.returncode, done.stdout) == (130, "killed\n")


def test_process_is_owned_by_the_main_thread_without_an_event_loop():
    async def cell():
        return owns_process()

    said = []
    thread = threading.Thread(target=lambda: said.append(owns_process()))
    thread.start()
    thread.join()
    assert (owns_process(), asyncio.run(cell()), said) == (True, False, [False])


@pytest.mark.parametrize("threshold", [700, 0])
def test_garbage_collection_is_relaxed_inside_and_restored(threshold):
    before = gc.get_threshold()
    gc.set_threshold(threshold, 10, 10)
    try:
        with pytest.raises(ValueError, match="inside"), few_collections():
            assert gc.get_threshold()[0] >= 10 * threshold
            assert threshold or gc.get_threshold()[0] == 0
            raise ValueError("inside")
        assert gc.get_threshold() == (threshold, 10, 10)
    finally:
        gc.set_threshold(*before)


GIVES_BACK = """
import psutil

from vastflow.tasks.engine.process import return_freed_memory

return_freed_memory()
import pyarrow as pa

assert pa.default_memory_pool().backend_name == "system"
pa.array(range(10))  # which imports
process = psutil.Process()
before = process.memory_info().rss
tables = [pa.array(range(100_000)) for _ in range(100)]
held = process.memory_info().rss - before
del tables
print(held, process.memory_info().rss - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only glibc's malloc is told")
def test_freed_tables_leave_no_memory_behind():
    printed = subprocess.run(
        [sys.executable, "-c", GIVES_BACK], capture_output=True, text=True, check=True, timeout=240
    )
    held, left = map(int, printed.stdout.split())
    assert held > 70e6
    assert left < held / 5
