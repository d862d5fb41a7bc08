import shlex
import sys
import time
from types import SimpleNamespace

import pytest
import yaml
from py_trees.common import Status
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.definition import EnumValue
from vastflow.sim.scenario.programs.actions import process_actions
from vastflow.sim.scenario.programs.run import process_run
from vastflow.sim.scenario.tree.action import ActionSituation

pytestmark = pytest.mark.timeout(900)

SLEEPS = "import time; print('ready', flush=True); time.sleep(600)"


@pytest.fixture
def run(tmp_path):
    with process_run(ProcessSetup(), where=tmp_path) as run:
        yield run


@pytest.fixture
def entered(run):
    """Makes an action of this name, enters it with these arguments, and shuts it down at the end."""
    actions = []

    def enter(name, label="", **arguments):
        situation = ActionSituation({}, label, SimpleNamespace(now_s=0.0), {}, lambda line: None)
        action = process_actions(run)[name](situation)
        actions.append(action)
        action.enter(arguments)
        return action

    yield enter
    for action in actions:
        action.shutdown()
    assert run.pids() == set()


def python(text):
    return shlex.join([sys.executable, "-c", text])


def outcome(action):
    """Status and message of an action at its end."""
    while (status := action.update()) is Status.RUNNING:
        time.sleep(0.005)
    return status, action.message


def until_printed(run, label):
    while b"ready" not in run.labeled(label).log.read():
        time.sleep(0.005)


@each_row(
    ("command", "status", "message"),
    [
        ("sh -c 'exit 0'", Status.SUCCESS, "sh exited with code 0"),
        ("sh -c 'echo no route >&2; exit 1'", Status.FAILURE, "sh exited with code 1: no route"),
    ],
)
def test_program_succeeds_with_code_0_and_fails_with_its_last_words(entered, command, status, message):
    assert outcome(entered("run_process", command=command)) == (status, message)


@each_row(
    ("command", "message"),
    [
        ("no-such-program --fast", "'no-such-program' could not be started: no program of this name in PATH"),
        ("", "expected a command, got nothing"),
        ("echo 'a", 'command "echo \'a": no closing quotation'),
    ],
)
def test_command_that_can_not_be_started_is_no_failure_of_a_program(entered, command, message):
    with pytest.raises(ScenarioError, match=message):
        entered("run_process", command=command)


def test_quotes_keep_blanks_in_a_word_and_no_shell_reads_the_command(entered, run):
    outcome(entered("run_process", "echo", command="""echo 'a  b' "$HOME" > c"""))
    run.labeled("echo").stop()
    assert run.labeled("echo").log.read() == b"a  b $HOME > c\n"


def test_background_program_succeeds_at_once_and_keeps_running(entered, run):
    action = entered("run_process", "sim", command=python(SLEEPS), wait_for_shutdown=False)
    assert action.update() is Status.SUCCESS
    assert run.waiting
    action.shutdown()
    assert not run.waiting


def test_abandoned_program_gets_requested_signal(entered, run):
    text = "import signal; signal.signal(signal.SIGUSR1, lambda *_: exit(7)); " + SLEEPS
    usr1 = EnumValue("signal", "sigusr1", 10)
    action = entered("run_process", "sim", command=python(text), shutdown_signal=usr1, shutdown_timeout=20.0)
    assert action.update() is Status.RUNNING
    until_printed(run, "sim")
    action.cancel()
    assert run.labeled("sim").failure == "exited with code 7"


def test_repeated_action_restarts_program(entered, run):
    command = python("open('times', 'a').write('x')")
    action = entered("run_process", command=command)
    outcome(action)
    action.enter({"command": command})
    assert outcome(action)[0] is Status.SUCCESS
    assert (run.folders.out / "times").read_text() == "xx"


def test_log_check_succeeds_when_a_value_is_printed_though_in_two_writes(entered):
    check = entered("process_log_check", process_name="sim", values=["never", "one two"])
    assert check.update() is Status.RUNNING
    assert check.message == "no run_process labeled 'sim' has begun"
    text = "import time; print('one t', end='', flush=True); time.sleep(0.1); print('wo', flush=True); time.sleep(600)"
    entered("run_process", "sim", command=python(text))
    assert outcome(check) == (Status.SUCCESS, "'sim' printed 'one two'")


def test_log_check_fails_when_program_has_ended(entered, run):
    entered("run_process", "sim", command=python(SLEEPS))
    until_printed(run, "sim")
    check = entered("process_log_check", process_name="sim", values=["ready"], from_start=False)
    assert check.update() is Status.RUNNING
    run.labeled("sim").stop()
    assert outcome(check) == (Status.FAILURE, "it ended before 'sim' printed 'ready'")


def test_process_of_this_run_is_found_by_command_line_label_or_pattern(entered, run):
    entered("run_process", "planner", command=python(SLEEPS))
    until_printed(run, "planner")

    def running(name, regex=False):
        return entered("check_process_running", process_name=name, regex=regex).update() is Status.SUCCESS

    assert running("time.sleep(600)")
    assert running("plan")
    assert running(r"^python.*sleep\(\d+\)$", regex=True)
    assert not running(r"^python.*sleep\(\d+\)$")
    assert not running("gz")  # of the machine, or of nobody


OUTSIDE = {"file_path": "x.yaml", "key_path": "a", "value": "2", "output_file": "/tmp/x.yaml"}


@each_row(
    ("action", "arguments", "message"),
    [
        ("check_process_running", {"process_name": "(", "regex": True}, r"'\(' is no regular expression"),
        ("monitor_resources", {"file_name": "../use.csv"}, "expected a file below the run's folder, got '../use"),
        ("set_yaml_value", OUTSIDE, "set_yaml_value: expected an output_file in the run's folder"),
    ],
)
def test_argument_that_no_run_can_have_is_the_scenarios_error(entered, action, arguments, message):
    with pytest.raises(ScenarioError, match=message):
        entered(action, **arguments)


def test_files_are_searched_in_run_folder(entered, run):
    (run.folders.out / "there").touch()
    for name, file, other in (("check_file_exists", "there", "gone"), ("check_file_not_exists", "gone", "there")):
        assert entered(name, file_name=file).update() is Status.SUCCESS
        assert entered(name, file_name=other).update() is Status.FAILURE


def test_resource_series_are_written_at_end(entered, run):
    monitor = entered("monitor_resources", file_name="logs/use.csv")
    assert monitor.update() is Status.RUNNING
    entered("run_process", "sim", command=python(SLEEPS))
    until_printed(run, "sim")
    monitor.shutdown()
    header, *rows = (run.folders.out / "logs/use.csv").read_text().splitlines()
    assert header == "t_s,cpu_s,rss_bytes,processes"
    assert rows


@each_row(
    ("arguments", "changed"),
    [
        ({"key_path": "a.b", "value": "x"}, {"a": {"b": "x", "c": [1, 2]}}),
        ({"key_path": "a.b", "value": "2", "value_type": "int"}, {"a": {"b": 2, "c": [1, 2]}}),
        ({"key_path": "a.b", "value": "2.5", "value_type": "float"}, {"a": {"b": 2.5, "c": [1, 2]}}),
        ({"key_path": "a.c.1", "value": "true", "value_type": "bool"}, {"a": {"b": 1, "c": [1, True]}}),
        ({"key_path": "d.e", "value": "x"}, {"a": {"b": 1, "c": [1, 2]}, "d": {"e": "x"}}),
    ],
)
def test_value_of_a_yaml_file_is_set(entered, run, arguments, changed):
    (run.folders.out / "x.yaml").write_text("a: {b: 1, c: [1, 2]}\n")
    assert entered("set_yaml_value", file_path="x.yaml", **arguments).update() is Status.SUCCESS
    assert yaml.safe_load((run.folders.out / "x.yaml").read_text()) == changed


@each_row(
    ("arguments", "message"),
    [
        ({"key_path": "a.c.2"}, "key_path 'a.c.2' leads nowhere: there is no '2'"),
        ({"key_path": "a.x.y", "create_missing": False}, "key_path 'a.x.y' leads nowhere: there is no 'x'"),
        ({"key_path": "a.x", "create_missing": False}, "key_path 'a.x' leads nowhere: there is no 'x'"),
        ({"key_path": "a.b", "value_type": "int"}, "expected one of type int, got value 'v'"),
        ({"key_path": "a.b", "value_type": "bool"}, "expected true or false, got 'v'"),
        ({"key_path": "a.b", "value_type": "text"}, "expected a value_type of str, int, float, bool, got value_type "),
    ],
)
def test_value_that_can_not_be_set_fails(entered, run, arguments, message):
    (run.folders.out / "x.yaml").write_text("a: {b: 1, c: [1, 2]}\n")
    action = entered("set_yaml_value", file_path="x.yaml", **{"value": "v", **arguments})
    assert action.update() is Status.FAILURE
    assert action.message.startswith(message)
    assert (run.folders.out / "x.yaml").read_text() == "a: {b: 1, c: [1, 2]}\n"
