import asyncio
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import pytest

from vastflow.tasks.engine.process import owns_process, terminable

pytestmark = pytest.mark.timeout(900)


def test_sigterm_interrupts_as_ctrl_c_does():
    with pytest.raises(KeyboardInterrupt), terminable():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_program_with_its_own_idea_of_sigterm_keeps_it():
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


def test_main_thread_of_a_script_owns_its_process():
    assert owns_process()


def test_notebooks_cell_does_not_own_the_kernel():
    async def cell():
        return owns_process()

    assert asyncio.run(cell()) is False


def test_another_thread_does_not_own_the_process():
    said = []
    thread = threading.Thread(target=lambda: said.append(owns_process()))
    thread.start()
    thread.join()
    assert said == [False]
