"""A command with a script before it and one after it, as bash runs them."""

import os
import signal
import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.tasks.prefect.containers import wrapped

ARGUMENT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)


@pytest.fixture
def scripts(tmp_path):
    """A script to be sourced and one to be run, at paths that need quotes."""
    folder = tmp_path / "it's a $folder"
    folder.mkdir()
    pre, post = folder / "pre.sh", folder / "post.sh"
    pre.write_text('export GREETING="sourced $#"\n')
    post.write_text("#!/bin/bash\necho after\n")
    post.chmod(0o755)
    return pre, post


def ran(command):
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_wrapped_leaves_command_without_scripts_and_refuses_that_of_image():
    assert wrapped(["run", "a b"], None, None) == ("run", "a b")
    with pytest.raises(ValueError, match="is not known outside of it"):
        wrapped([], "/pre.sh", None)


def test_wrapped_command_sees_exports_and_keeps_exit_code(scripts):
    pre, post = map(str, scripts)
    for code in (0, 7):
        command = ["bash", "-c", f'echo "$GREETING"; exit {code}']
        for around in ((pre, None), (pre, post), (None, post)):
            done = ran(wrapped(command, *around))
            said = ("sourced 0\n" if around[0] else "\n") + ("after\n" if around[1] else "")
            assert (done.returncode, done.stdout) == (code, said)
    assert ran(wrapped(["true"], None, "/no/such/script")).returncode == 0


@pytest.mark.parametrize("content", ["return 3", None])
def test_command_does_not_run_after_failed_script(scripts, content):
    pre, post = scripts
    pre.unlink() if content is None else pre.write_text(content)
    done = ran(wrapped(["echo", "run"], str(pre), str(post)))
    assert (done.returncode, done.stdout) == (1 if content is None else 3, "")


def test_stop_reaches_the_command_and_the_script_after_it_still_runs(scripts):
    _, post = map(str, scripts)
    command = ["bash", "-c", "trap 'echo stopped; exit 9' TERM; echo ready; while :; do sleep 0.02; done"]
    started = subprocess.Popen(wrapped(command, None, post), stdout=subprocess.PIPE, text=True)
    assert started.stdout.readline() == "ready\n"
    os.kill(started.pid, signal.SIGTERM)
    assert started.communicate(timeout=120)[0] == "stopped\nafter\n"
    assert started.returncode == 9


@settings(max_examples=30, deadline=None)
@given(st.lists(ARGUMENT, max_size=4), st.booleans())
def test_arguments_keep_all_characters(arguments, is_followed):
    command = wrapped(["printf", r"%s\0", "first", *arguments], "/dev/null", "/bin/true" if is_followed else None)
    found = subprocess.run(command, capture_output=True, timeout=120, check=True).stdout
    assert found.decode().split("\0")[1:-1] == arguments
