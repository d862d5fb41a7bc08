"""Code of others: reading a directory executes nothing, and executing it needs a record of this user's."""

import json
import os
import shutil
import stat
import subprocess
import sys
from dataclasses import replace

import pytest
from command_line import called, refused
from hostile import executed, stranger

from vastflow.flows.analysis.minimize import minimize_configuration
from vastflow.flows.request.run_request import asked_of
from vastflow.flows.results import trust
from vastflow.flows.results.inputs import replica
from vastflow.flows.results.trust import NotPermitted, executing, foreign_code, permitted_contents, remember_made
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.files import read_json
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.plug_ins.loading import code_from, module_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import snapshot_of
from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.run import run
from vastflow.tasks.engine.process import own_environment, python_command


@pytest.fixture
def state(tmp_path, monkeypatch):
    """The user's state folder, which is empty at first."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "vastflow" / "permitted"


@pytest.fixture
def canary(tmp_path):
    return tmp_path / "canary"


@pytest.fixture
def foreign(tmp_path, canary, state):
    return stranger(tmp_path / "results", canary)


def test_commands_that_read_execute_nothing(foreign, tmp_path, canary):
    assert called("show", foreign).exit_code == 0
    assert called("compare", foreign, foreign, "--out", tmp_path / "compared").exit_code == 0
    assert called("export", foreign, tmp_path / "exported").exit_code == 0
    assert executed(canary) == []


@pytest.mark.parametrize("command", [("replay", "DIRECTORY", "room", "0"), ("run", "DIRECTORY"), ("plan", "DIRECTORY")])
def test_commands_that_execute_name_the_code_and_the_option_without_a_terminal(foreign, canary, command):
    arguments = [str(foreign) if each == "DIRECTORY" else each for each in command]
    asked = python_command("vastflow.flows.cli", *arguments)  # a process that has read no plug-in before
    result = subprocess.run(asked, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, check=False)
    words = result.stderr.splitlines()[-1]
    assert (result.returncode, "Traceback" in result.stderr) == (2, False)
    assert "would execute code that you neither made nor permitted: inputs/my_pursuit.py" in words
    assert "--trust" in words and foreign_code(foreign).digest[:12] in words
    assert executed(canary) == []


def test_minimize_executes_nothing_without_permission(foreign, canary):
    assert "--trust" in refused("minimize", foreign, "room")
    assert executed(canary) == []


def test_permission_is_a_private_record_of_this_content_alone(foreign, state):
    with pytest.raises(NotPermitted, match=r"neither made nor permitted: .*Permit it by --trust"):
        permitted_contents(foreign)
    with pytest.raises(NotPermitted, match="neither made nor permitted"):
        permitted_contents(foreign, "of something else")
    digest = foreign_code(foreign).digest
    contents = permitted_contents(foreign, digest)
    assert permitted_contents(foreign) == contents != frozenset()
    assert stat.S_IMODE(os.lstat(state).st_mode) == 0o700 and (state / digest).is_file()
    with (foreign / "inputs" / "my_pursuit.py").open("a") as file:
        file.write("# edited\n")
    with pytest.raises(NotPermitted, match=r"my_pursuit\.py"):
        permitted_contents(foreign)


@pytest.mark.parametrize(
    "place", ["campaign.vast", "metadata.json", "configurations.parquet", "inputs/new.py", "environments/files.json"]
)
def test_edit_of_executed_code_asks_again(foreign, place):
    remember_made(foreign)
    permitted_contents(foreign)
    with (foreign / place).open("ab") as file:
        file.write(b"\n")
    with pytest.raises((NotPermitted, UnusableDirectory), match=r"permitted|damaged"):
        permitted_contents(foreign)


@pytest.mark.parametrize("spoiled", ["a link", "open to others"])
def test_folder_of_records_that_others_may_have_made_is_no_proof(foreign, state, tmp_path, spoiled):
    remember_made(foreign)
    if spoiled == "a link":
        state.rename(tmp_path / "elsewhere")
        state.symlink_to(tmp_path / "elsewhere")
    else:
        state.chmod(0o755)
    with pytest.raises(NotPermitted, match="neither made nor permitted"):
        permitted_contents(foreign)
    remember_made(foreign)  # nor is one written there
    with pytest.raises(NotPermitted, match="neither made nor permitted"):
        permitted_contents(foreign)


def test_record_is_not_written_through_a_link(foreign, state, tmp_path):
    state.mkdir(mode=0o700, parents=True)
    (state / foreign_code(foreign).digest).symlink_to(tmp_path / "target")
    (tmp_path / "target").write_text("kept")
    remember_made(foreign)
    assert (tmp_path / "target").read_text() == "kept"
    permitted_contents(foreign)


@pytest.mark.parametrize("kind", ["link", "folder", "pipe"])
def test_permission_refuses_links_and_pipes_in_inputs(foreign, tmp_path, kind):
    place = foreign / "inputs" / "more.py"
    if kind == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to(tmp_path if kind == "folder" else foreign / "metadata.json")
    with pytest.raises(UnusableDirectory, match="expected a file or a folder, got a link, a pipe, or a device"):
        permitted_contents(foreign, "")


def test_data_alone_asks_nothing(tmp_path, canary, state):
    plain = stranger(tmp_path / "results", canary, plug_in=False)
    assert foreign_code(plain).named == ()
    assert permitted_contents(plain) == permitted_contents(plain, "of something else")
    assert not state.exists()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("execution: {pre_command: ./evil.sh}", "pre_command './evil.sh'"),
        ('execution: {"post\\x5fcommand": ./evil.sh}', "post_command './evil.sh'"),
        (
            "execution: {containers: {a: {rootfs: /, mounts: [{source: /root, target: /x}, {source: data, target: /y}]}}}",
            "container 'a' of '/', which sees '/root'",
        ),
        ("execution: {nodes: [{a: {command: evil --now}}]}", "node 'a' by 'evil --now'"),
        ("results_processing: {postprocessing: [command: {script: evil}]}", "postprocessing by command"),
    ],
)
def test_programs_of_the_campaign_file_are_named(tmp_path, canary, state, text, named):
    plain = stranger(tmp_path / "results", canary, plug_in=False)
    (plain / "campaign.vast").write_text(f"version: 1\n{text}\n")
    assert foreign_code(plain).named == (named,)


def test_scenario_that_starts_programs_is_named(tmp_path, canary, state):
    plain = stranger(tmp_path / "results", canary, plug_in=False)
    (plain / "inputs" / "room.osc").write_text("scenario a:\n    do serial:\n        run_process('evil')\n")
    assert foreign_code(plain).named == ("inputs/room.osc",)


def test_code_is_opened_only_if_its_content_is_permitted(foreign, canary):
    inputs = foreign / "inputs"
    snapshot = snapshot_of(inputs / "my_pursuit.py", inputs)
    with code_from(()), pytest.raises(PlugInError, match="code of others that you have not permitted"):
        module_of(snapshot)
    assert executed(canary) == []
    with code_from(permitted_contents(foreign, "")):
        assert module_of(replace(snapshot, campaign=foreign)).__name__.endswith("my_pursuit")
    assert len(executed(canary)) == 1


def test_children_are_shaped_by_no_working_directory(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", "here", "/there"]))
    monkeypatch.setenv("PYTHONSTARTUP", "evil.py")
    monkeypatch.setenv("PYTHONUTF8", "1")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "kept")
    found = own_environment()
    assert (found["PYTHONPATH"], found["PYTHONUTF8"], found["AWS_SECRET_ACCESS_KEY"]) == ("/there", "1", "kept")
    assert "PYTHONSTARTUP" not in found
    assert python_command("a.b", "c") == [sys.executable, "-P", "-m", "a.b", "c"]


def test_running_campaign_is_known_by_the_record_of_its_user_alone(tmp_path, state):
    directory = tmp_path / "results" / "a-2026-11-20-060000"
    assert trust.running_as(directory) is None
    trust.remember_running(directory, {"file": "/a.vast"})
    assert trust.running_as(directory) == {"file": "/a.vast"}
    (record,) = (state.parent / "running").iterdir()
    record.write_text(json.dumps([]))
    assert trust.running_as(directory) is None
    trust.remember_running(directory, None)
    assert list((state.parent / "running").iterdir()) == []


def test_permission_goes_with_the_content_to_another_folder(foreign, tmp_path):
    remember_made(foreign)
    shutil.copytree(foreign, tmp_path / "moved")
    assert permitted_contents(tmp_path / "moved") == permitted_contents(foreign)


def test_minimize_of_the_python_api_asks_too(foreign, canary):
    with pytest.raises(NotPermitted, match=r"neither made nor permitted: .*my_pursuit\.py"):
        minimize_configuration(foreign, "room")
    assert executed(canary) == []


def test_body_within_another_takes_its_permission(foreign, canary):
    with code_from(()), executing(foreign), pytest.raises(PlugInError, match="code of others"):
        module_of(snapshot_of(foreign / "inputs" / "my_pursuit.py", foreign / "inputs"))
    assert executed(canary) == []


@pytest.mark.timeout(120)
def test_programs_start_only_in_a_scenario_that_was_permitted(tmp_path):
    (tmp_path / "room.osc").write_text(
        f"import osc.helpers\nscenario a:\n    do serial:\n        run_process('touch {tmp_path}/done')\n"
    )
    scenario = Scenario(abstract_content(tmp_path / "room.osc"), 20.0, {}, {}, {})
    with (
        code_from(("of another scenario",)),
        pytest.raises(PlugInError, match=r"programs of the scenario.* not permitted"),
    ):
        run(scenario, 0)
    assert not (tmp_path / "done").exists()
    with code_from((scenario.digest,)):
        run(scenario, 0)
    assert (tmp_path / "done").exists()


@pytest.mark.parametrize("file", ["campaign.vast", "inputs/my_pursuit.yaml"])
def test_file_that_changed_since_the_permission_is_not_laid_out(foreign, file):
    asked = asked_of(read_json(foreign / "metadata.json"))
    with executing(foreign, ""):
        (foreign / file).write_text((foreign / file).read_text() + "# later\n")
        with (
            pytest.raises(UnusableDirectory, match="is code of others that you have not permitted"),
            replica(foreign, asked),
        ):
            pass
