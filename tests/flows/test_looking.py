"""Commands that only look at a campaign execute nothing of it that has an effect."""

import pytest
from table import each_row
from typer.testing import CliRunner

from vastflow.flows.__main__ import app

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
PRODUCER = """\
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer
{imported}
class Words(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {{"word": None}}

    def produce(self, inputs, draws):
        {produced}
        yield Fragment({{"word": "a"}})
"""
TOUCH = "open({mark!r}, 'w')"
COMMANDS = (["validate"], ["plan"], ["plan", "--why", "--coverage"])


@pytest.fixture
def looked(tmp_path, monkeypatch):
    """Return the output and exit code of a command, and whether anything of the campaign had an effect."""
    folder, mark = tmp_path / "campaign", tmp_path / "mark"
    folder.mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    (folder / "x.vast").write_text(CAMPAIGN)
    (folder / "touch.sh").write_text(f"touch {mark}")
    (folder / "own_oracle.ipynb").write_text(NOTEBOOK.replace("MARK", str(mark)))
    (folder / "scenario.osc").write_text(
        f'import osc.helpers\nscenario x:\n    word: string = ""\n    do run_process("touch {mark}")\n'
    )

    def look(command, imported="", produced="pass"):
        texts = {"imported": imported.format(mark=str(mark)), "produced": produced.format(mark=str(mark))}
        (folder / "own.py").write_text(PRODUCER.format(**texts))
        result = CliRunner().invoke(app, [*command, str(folder / "x.vast")])
        left = {path.name for path in folder.iterdir()} - {"__pycache__"}
        assert left == {"x.vast", "touch.sh", "own_oracle.ipynb", "scenario.osc", "own.py"}
        return result.exit_code, result.output, mark.exists()

    return look


@each_row("command", COMMANDS)
def test_looking_executes_no_script_program_notebook_or_step(looked, command):
    code, said, is_marked = looked(command)
    assert (code, is_marked) == (0, False), said


@each_row("command", COMMANDS)
@each_row("when", ["imported", "produced"])
def test_plug_in_has_no_effects_and_is_told(looked, command, when):
    code, said, is_marked = looked(command, **{when: TOUCH})
    assert not is_marked
    assert code == 2
    assert "EffectRefused: it would write to a file" in said
