"""Commands that only look at a campaign: plug-ins end no command, and pipes are refused."""

import os

import pytest
from command_line import called, refused
from table import each_row

from vastflow.sim.plug_ins.effects import Interrupted, PlugInExit, plug_in_code
from vastflow.tasks.engine.work import Broken, answered

CAMPAIGN = """\
version: 1
configuration:
  - name: one
    variations:
      - own.py:Words: {}
execution:
  scenario_file: scenario.osc
  run_files: ["*.sh"]
  pre_command: /config/touch.sh
  post_command: /config/touch.sh
evaluation:
  oracles: [own_oracle.ipynb]
  visualization: [Tab: {run: own_oracle.ipynb}]
results_processing:
  postprocessing: [command: {script: touch.sh}]
"""
NOTEBOOK = """\
{"cells": [{"cell_type": "code", "metadata": {}, "outputs": [], "execution_count": null,
            "source": "import os; os.system('touch MARK'); verdicts = []"}],
 "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
"""
SCENARIO = 'import osc.helpers\nscenario x:\n    word: string = ""\n    do run_process("touch MARK")\n'
PRODUCER = """\
import sys
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer
{imported}
class Words(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {{"word": None}}

    def __init__(self, parameters):
        super().__init__(parameters)
        {made}

    def produce(self, inputs, draws):
        {produced}
        yield Fragment({{"word": "a"}})
"""
ORACLE = """
import sys
from vastflow.oracles.judgment.oracle import Oracle, Parameters
{imported}
class Leaver(Oracle):
    Parameters = Parameters
    metrics = {{}}

    def __init__(self, *arguments):
        super().__init__(*arguments)
        {made}

    def judge(self, trace, situation):
        pass
"""
COMMANDS = ("validate", "plan", "plan --why --coverage")
EXIT = "its code raised SystemExit(0), which would end vastflow"


def code(text, **places):
    return text.format(**{"imported": "", "made": "pass", "produced": "pass", **places})


@pytest.fixture
def looked(tmp_path, monkeypatch):
    """Return the output and exit code of a command, and whether anything of the campaign had an effect."""
    folder, mark = tmp_path / "campaign", tmp_path / "mark"
    folder.mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    texts = {"x.vast": CAMPAIGN, "touch.sh": "touch MARK", "own_oracle.ipynb": NOTEBOOK, "scenario.osc": SCENARIO}

    def look(command, **places):
        for name, text in {**texts, "own.py": code(PRODUCER, **places)}.items():
            (folder / name).write_text(text.replace("MARK", str(mark)))
        result = called(*command.split(), folder / "x.vast")
        assert {path.name for path in folder.iterdir()} - {"__pycache__"} == {*texts, "own.py"}
        return result.exit_code, result.output, mark.exists()

    return look


@each_row("command", COMMANDS)
def test_looking_executes_no_script_program_notebook_or_step(looked, command):
    code, said, is_marked = looked(command)
    assert (code, is_marked) == (0, False), said


NAMING = {
    PRODUCER: "configuration: [{name: a, variations: [{'own.py:Words': {}}]}]",
    ORACLE: "configuration: [{name: a}]\nevaluation: {oracles: ['own.py:Leaver']}",
}


@each_row(
    ("plug_in", "place", "statement", "words"),
    [
        *((PRODUCER, place, "sys.exit(0)", EXIT) for place in ("imported", "made", "produced")),
        (PRODUCER, "produced", "raise GeneratorExit", "its code raised GeneratorExit, which would end vastflow"),
        *((ORACLE, place, "sys.exit(0)", EXIT) for place in ("imported", "made")),
        (ORACLE, "made", "1 / 0", "raised ZeroDivisionError: division by zero"),
    ],
)
def test_plug_in_that_ends_process_or_raises_is_fault_of_file(tmp_path, plug_in, place, statement, words):
    (tmp_path / "own.py").write_text(code(plug_in, **{place: statement}))
    file = tmp_path / "c.vast"
    file.write_text(f"version: 1\n{NAMING[plug_in]}\n")
    result = called("validate", file)
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{file}:{2 if plug_in == PRODUCER else 3}:" in result.stderr and words in result.stderr


def test_plug_in_code_turns_only_exits_into_errors():
    for raised, caught, words in (
        (KeyboardInterrupt("now"), KeyboardInterrupt, "now"),
        (Interrupted("canceled"), Interrupted, "canceled"),
        (LookupError("own"), LookupError, "own"),
        (SystemExit("words"), PlugInExit, r"SystemExit\('words'\)"),
    ):
        with pytest.raises(caught, match=words), plug_in_code():
            raise raised

    def judge():
        raise SystemExit(0)

    assert answered(judge) == Broken(f"PlugInExit: {EXIT}")


def test_command_exits_with_3_for_exit_from_anywhere_else(monkeypatch, tmp_path):
    def leave(*arguments, **named):
        raise SystemExit(0)

    monkeypatch.setattr("vastflow.flows.request.campaign_file.read_campaign", leave)
    result = called("validate", tmp_path / "c.vast")
    assert result.exit_code == 3
    assert "a plug-in's code raised SystemExit(0), which would end vastflow" in result.stderr


POSES = "{start_pose: {x: 1, y: 1, yaw: 0}}, {goal_pose: {x: 2, y: 1, yaw: 0}}"
ROOM = f"configuration: [{{name: a, parameters: [{POSES}]}}]"
NAMED = {
    "map": ROOM.replace("[{st", "[{map_file: pipe}, {st"),
    "picture": ROOM.replace("[{st", "[{map_file: of_pipe.yaml}, {st"),
    "endless picture": ROOM.replace("[{st", "[{map_file: of_zero.yaml}, {st"),
    "plan": ROOM.replace("]}]", "], variations: [{FloorplanGeneration: {floorplans: [pipe]}}]}]"),
    "producer": ROOM.replace("]}]", "], variations: [{'pipe.py:A': {}}]}]"),
    "oracle": f"{ROOM}\nevaluation: {{oracles: ['pipe.py:A']}}",
    "notebook": f"{ROOM}\nevaluation: {{oracles: [pipe.ipynb]}}",
    "scenario": f"{ROOM}\nexecution: {{scenario_file: pipe.osc}}",
    "parameters": f"{ROOM}\nexecution: {{nav2_params: pipe}}",
}


@pytest.fixture
def pipes(tmp_path, monkeypatch):
    for name in ("pipe", "pipe.osc", "pipe.py", "pipe.ipynb"):
        os.mkfifo(tmp_path / name)
    for name, image in (("of_pipe", "pipe"), ("of_zero", "/dev/zero")):
        (tmp_path / f"{name}.yaml").write_text(f"{{image: {image}, resolution: 0.05, origin: [0, 0, 0]}}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("what", NAMED)
def test_validate_refuses_campaign_that_names_pipe(pipes, what):
    (pipes / "c.vast").write_text(NAMED[what])
    result = called("validate", "c.vast")
    assert (result.exit_code, result.stdout, "c.vast:" in result.stderr) == (2, "", True)


@each_row(
    "arguments",
    [
        "validate pipe",
        "scenario check pipe.osc",
        "floorplan geometry pipe",
        "floorplan variations pipe --out drawn",
        "params pipe",
    ],
)
def test_command_refuses_pipe(pipes, arguments):
    assert "t is a pipe" in refused(*arguments.split())
