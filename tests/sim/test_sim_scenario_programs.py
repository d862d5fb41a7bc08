"""Programs that a scenario file starts with or without a robot: time, end, and remains."""

import os
import shlex
import sys
import time

import psutil
import pytest
from recorded import ends
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.run import PERIOD_S, execute
from vastflow.sim.scenario.programs.run import ResourceSampler

pytestmark = pytest.mark.timeout(900)


def program(code):
    """A command that runs some Python, as a text for a scenario file."""
    return '"' + f"{sys.executable} -S -E -c {shlex.quote(code)}".replace('"', '\\"') + '"'


def alone(scenario):
    """The same without a map: no robot."""
    return Scenario(scenario.abstract, scenario.timeout_s, {}, {}, {})


def running(mark):
    return [each.pid for each in psutil.process_iter(["cmdline"]) if mark in " ".join(each.info["cmdline"] or [])]


def test_program_runs_in_host_time_while_the_robot_drives(staged, tmp_path, monkeypatch):
    sample, sampled = ResourceSampler._sample, tmp_path / "sampled"

    def told(sampler):
        if (use := sample(sampler)).rss_bytes > 2**20:  # not yet, where a sample comes before the interpreter is loaded
            sampled.touch()
        return use

    monkeypatch.setattr(ResourceSampler, "_sample", told)
    wait = f"[time.sleep(0.01) for _ in iter(lambda: os.path.exists({str(sampled)!r}), True)]"
    code = program(f"import os, time; {wait}; time.sleep(0.3); sum(k * k for k in range(1_000_000)); print('done')")
    text = f"parallel:\n    robot.nav_to_pose(near)\n    waited: run_process({code})"
    began_s = time.monotonic()
    execution = execute(staged(text), 0)
    ((t_s, status, message),) = ends(execution.recording, "waited")
    assert (status, message.endswith("exited with code 0")) == ("SUCCESS", True)
    assert 0.3 <= t_s <= 0.2 + time.monotonic() - began_s + PERIOD_S
    log = execution.log
    assert [(text.label, text.text.strip()) for text in log.texts] == [("waited", "done")]
    assert log.cpu_s > 0.02 and log.max_rss_bytes > 2**20 and log.wall_s > 0.3
    assert execution.recording.run.outcome == "succeeded"


def test_parallel_program_does_not_change_robot(staged):
    beside = f"parallel:\n    robot.nav_to_pose(near)\n    run_process({program('pass')})"
    plain = execute(staged("robot.nav_to_pose(near)"), 0).recording
    paced = execute(staged(beside), 0).recording
    for name, column in plain.columns.items():  # the last row is of the run's end, which a slow program puts off
        assert len(column) > 40 and (paced.columns[name][: len(column) - 1] == column[:-1]).all(), name


def test_program_that_dies_fails_the_scenario_with_its_last_words(staged):
    code = program("import sys, time; time.sleep(0.4); print('lost the map', file=sys.stderr); sys.exit(3)")
    execution = execute(staged(f"parallel:\n    robot.nav_to_pose(beyond)\n    run_process({code})"), 0)
    run = execution.recording.run
    assert (run.outcome, run.error_code) == ("failed", 0)
    assert "exited with code 3: lost the map; run_process at trial.osc:" in run.reason
    assert ends(execution.recording, "nav_to_pose")[0][2] == "cancelled"


@each_row("modifier", ["", "failure_is_success()\n", "inverter()\n"])
def test_scenario_with_missing_program_is_a_fault(staged, modifier):
    text = f"serial:\n    {modifier}{'    ' if modifier else ''}run_process('no-such-program-here')"
    with pytest.raises(ScenarioError, match=r"here' could not be started: .*; run_process at trial\.osc:"):
        execute(staged(text), 0)


MARK = f"left by the tests of {os.getpid()}"
LEFT = program(f"import time; mark = '{MARK}'; time.sleep(600)")
NO_END = "the scenario did not end within its time"
GIVEN_UP = f"serial:\n    failure_is_success()\n    timeout(0.5s)\n    run_process({LEFT})\nrobot.nav_to_pose(near)"


@each_row(
    ("text", "is_alone", "outcome", "reason"),
    [
        (f"run_process({LEFT}, wait_for_shutdown: false)\nwait elapsed(0.5s)", False, "succeeded", ""),
        (GIVEN_UP, False, "succeeded", ""),
        (f"do serial:\n    run_process({LEFT})", True, "timed_out", f"{NO_END}, waiting for run_process"),
    ],
)
def test_program_ends_with_its_branch_or_with_the_run(staged, text, is_alone, outcome, reason):
    scenario = alone(staged(text, timeout_s=1.0)) if is_alone else staged(text)
    execution = execute(scenario, 0)
    assert (execution.recording.run.outcome, execution.recording.run.reason) == (outcome, reason)
    assert text != GIVEN_UP or ends(execution.recording, "run_process") == [(0.8, "INVALID", "cancelled")]
    assert running(MARK) == []


def test_scenario_of_programs_counts_host_time(staged):
    text = f"do serial:\n    run_process({program('import time; time.sleep(0.45)')})\n    log('over')"
    began_s = time.monotonic()
    execution = execute(alone(staged(text)), 0)
    took_s = time.monotonic() - began_s
    run = execution.recording.run
    assert (run.outcome, run.distance_m, execution.recording.columns) == ("succeeded", 0.0, {})
    assert 0.2 <= run.simulated_s <= took_s + 2 * PERIOD_S
    assert execution.log.lines[-1] == f"{run.simulated_s:.1f} s: over"


def test_host_time_passes_only_while_program_runs(staged):
    text = f"do serial:\n    run_process({program('pass')})\n    wait elapsed(1000s)"
    began_s = time.monotonic()
    execution = execute(alone(staged(text, timeout_s=2000.0)), 0)
    assert execution.recording.run.simulated_s > 1000.0
    assert time.monotonic() - began_s < 250.0
