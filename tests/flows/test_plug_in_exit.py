"""Plug-ins that try to end vastflow: an error of theirs with its place, never their exit code."""

import pytest
from table import each_row
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.sim.plug_ins.effects import PlugInExit, plug_in_code
from vastflow.tasks.engine.work import Broken, answered

PRODUCER = """
import sys
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer
{imported}
class Leaver(Producer):
    Parameters = Parameters
    def __init__(self, parameters):
        super().__init__(parameters)
        {made}
    @property
    def reads(self):
        return {reads}
    @property
    def writes(self):
        return {{"a": "system"}}
    def produce(self, inputs, draws):
        {produced}
        yield Fragment({{"a": 1}})
"""
ORACLE = """
import sys
from vastflow.oracles.judgement.oracle import Oracle, Parameters
{imported}
class Leaver(Oracle):
    Parameters = Parameters
    metrics = {{}}
    def __init__(self, *arguments):
        super().__init__(*arguments)
        {made}
    def judge(self, trace, situation):
        {produced}
"""
ENDS = {
    "sys.exit(0)": r"its code raised SystemExit(0), which would end vastflow",
    "raise GeneratorExit": "its code raised GeneratorExit, which would end vastflow",
}


def campaign(folder, code, reads="()", oracle=False, **places):
    words = {"imported": "", "made": "pass", "produced": "pass", "reads": reads, **places}
    (folder / "plug.py").write_text(code.format(**words))
    evaluation = "evaluation: {oracles: ['plug.py:Leaver']}\n" if oracle else ""
    variations = "" if oracle else "    variations: [{'plug.py:Leaver': {}}]\n"
    file = folder / "c.vast"
    file.write_text(f"version: 1\nconfiguration:\n  - name: a\n{variations}{evaluation}")
    return str(file)


@each_row("end", ENDS)
@each_row("place", ["imported", "made", "produced"])
def test_producer_that_ends_the_process_is_a_fault_of_the_file(tmp_path, place, end):
    result = CliRunner().invoke(app, ["validate", campaign(tmp_path, PRODUCER, **{place: end})])
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{tmp_path}/c.vast:4:19: configuration[0].variations[0].plug.py:Leaver: " in result.stderr
    assert ENDS[end] in result.stderr


@each_row("place", ["imported", "made"])
def test_oracle_that_ends_the_process_is_a_fault_of_the_file(tmp_path, place):
    result = CliRunner().invoke(app, ["validate", campaign(tmp_path, ORACLE, oracle=True, **{place: "sys.exit(0)"})])
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{tmp_path}/c.vast:4:" in result.stderr and ENDS["sys.exit(0)"] in result.stderr


def test_oracle_that_can_not_be_made_is_a_fault_of_the_file(tmp_path):
    result = CliRunner().invoke(app, ["validate", campaign(tmp_path, ORACLE, oracle=True, made="1 / 0")])
    assert result.exit_code == 2
    assert "it raised ZeroDivisionError: division by zero; an oracle that can be made" in result.stderr


def test_job_of_a_worker_whose_plug_in_ends_the_process_is_broken(capsys):
    def judge():
        raise SystemExit(0)

    assert answered(judge) == Broken("PlugInExit: its code raised SystemExit(0), which would end vastflow")


def test_ctrl_c_in_a_plug_in_stays_ctrl_c():
    with pytest.raises(KeyboardInterrupt), plug_in_code():
        raise KeyboardInterrupt


def test_error_of_a_plug_in_stays_that_error():
    with pytest.raises(LookupError, match="own"), plug_in_code():
        raise LookupError("own")
    with pytest.raises(PlugInExit, match=r"SystemExit\('words'\)"), plug_in_code():
        raise SystemExit("words")


def test_exit_that_comes_from_anywhere_else_is_no_exit_code_of_a_command(monkeypatch, tmp_path):
    def leave(*arguments, **named):
        raise SystemExit(0)

    monkeypatch.setattr("vastflow.flows.request.campaign_file.read_campaign", leave)
    result = CliRunner().invoke(app, ["validate", str(tmp_path / "c.vast")])
    assert result.exit_code == 3
    assert "a plug-in's code raised SystemExit(0), which would end vastflow" in result.stderr
