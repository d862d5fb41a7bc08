"""Child processes: answers, limits, and an end with the process that started them."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.child import Child, NoAnswer
from vastflow.tasks.engine.process import own_environment

pytestmark = pytest.mark.timeout(120)

ANSWERS = """
import os, re, subprocess, sys, time
from pathlib import Path
from vastflow.sim.model.faults import UserError
def echo(request): return request
def number(request): return os.getpid()
def content(request): return bytes(request)
def printing(request):
    print("[1]", flush=True); os.system("echo [2]"); sys.__stdout__.write("[3]")
    return sys.stdin.read()
def raising(request): raise UserError("expected\\na map, got none")
def breaking(request): return {}[request]
def leaving(request): print("about to leave"); sys.exit(request)
def closing(request): os.closerange(0, 64); time.sleep(60)
def endless(request):
    while True: pass
def holding(request): re.match("(a+)+$", "a" * 60 + "b")
def large(request): return len(bytearray(request))
def written(request): Path("file").write_bytes(bytes(request))
def started(request): return subprocess.Popen(["sleep", "60"]).pid
def within(request): import stray
"""


@pytest.fixture
def child(tmp_path):
    """A function that starts a child with a function of `ANSWERS`."""
    (tmp_path / "answers_of_test.py").write_text(ANSWERS)
    environment = {**own_environment(), "PYTHONPATH": str(tmp_path)}

    def start(function, **limits):
        return Child(f"answers_of_test:{function}", environment=environment, **limits)

    return start


def ended(pid: int) -> bool:
    """Whether a process ends within some seconds."""
    until_s = time.monotonic() + 20.0
    while time.monotonic() < until_s:
        try:
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.02)
    return False


def test_child_answers_request_by_request_with_values_and_bytes(child):
    with child("echo") as echo:
        assert [echo.ask(each, 60.0) for each in (1, {"a": [None, "ü\n"]}, "x" * 300_000)][1] == {"a": [None, "ü\n"]}
    with child("content") as content:
        assert [len(content.ask(size)) for size in (0, 10, 1_000_000)] == [0, 10, 1_000_000]


def test_child_that_prints_and_reads_spoils_no_answer(child):
    with child("printing") as printing:
        assert [printing.ask(0), printing.ask(0)] == ["", ""]


def test_error_of_user_is_its_words_and_of_code_its_type_too(child):
    with child("raising") as raising, pytest.raises(UserError, match=r"^expected a map, got none$"):
        raising.ask(0)
    with child("breaking") as breaking:
        for _ in range(2):
            with pytest.raises(UserError, match=r"^KeyError: 'a'$"):
                breaking.ask("a")


def test_child_that_leaves_or_closes_its_pipes_gives_no_answer(child):
    with child("leaving") as leaving:
        for _ in range(2):
            with pytest.raises(NoAnswer, match=r"^its process ended with code 3 without an answer: about to leave$"):
                leaving.ask(3)
    with child("closing") as closing, pytest.raises(NoAnswer, match=r"^its process was ended by signal 9 without"):
        closing.ask(0)


def test_endless_child_is_killed(child):
    with child("endless") as endless, pytest.raises(NoAnswer, match=r"^its process took more than 1\.5 s$"):
        endless.ask(0, 1.5)


def test_child_keeps_limits_of_memory_and_files(child, tmp_path):
    with child("large", memory_bytes=1 << 30) as large:
        with pytest.raises(UserError, match=r"^expected to take at most 1\.0 GiB of memory, got more$"):
            large.ask(2 << 30)
        assert large.ask(1 << 20) == 1 << 20
    with (
        child("written", file_bytes=1000, folder=tmp_path) as written,
        pytest.raises(UserError, match=r"OSError: .*large"),
    ):
        written.ask(2000)


def test_child_imports_nothing_of_its_folder(child, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "stray.py").write_text("")
    with (
        child("within", folder=tmp_path / "there") as within,
        pytest.raises(UserError, match="No module named 'stray'"),
    ):
        within.ask(0)


def test_end_kills_child_and_what_it_started(child):
    with child("started") as started:
        pid = started.ask(0)
        assert psutil.pid_exists(pid)
    assert ended(pid)


@pytest.mark.parametrize("function", ["endless", "holding", "started"])
def test_killed_process_leaves_no_child(child, tmp_path, function):
    """Kill it within a request, also of one that lets no other thread run, or between two."""
    child(function).__exit__()
    script = (
        "import sys, time\nfrom vastflow.tasks.engine.child import Child\n"
        f"child = Child('answers_of_test:{function}')\nprint(child._process.pid, flush=True)\n"
        f"print(child.ask(0), flush=True)\ntime.sleep(60)\n"
    )
    environment = {**own_environment(), "PYTHONPATH": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, env=environment) as parent:
        pids = [int(parent.stdout.readline())]
        if function == "started":
            pids.append(int(parent.stdout.readline()))
        else:
            time.sleep(2.0)  # until the request is under way
        assert all(map(psutil.pid_exists, pids))
        os.kill(parent.pid, signal.SIGKILL)
    assert all(map(ended, pids))
