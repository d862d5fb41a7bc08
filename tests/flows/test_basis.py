"""The basis of a run: which files its results follow from, or that files alone do not tell."""

from pathlib import Path

import pytest

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.run.reporting import basis_of
from vastflow.sim.model.digest import file_digest

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"


OWN = """\
from limits import MOST_S
from vastflow.oracles.judgement.oracle import Oracle, Parameters
from vastflow.oracles.judgement.verdict import Verdict


class QuickParameters(Parameters):
    pass


class Quick(Oracle[QuickParameters]):
    Parameters = QuickParameters
    files = ["most.txt"]

    def judge(self, trace, situation):
        return Verdict("quick", trace.run_index, "pass" if trace.duration_s < MOST_S else "fail", "", {})
"""


@pytest.fixture
def campaign(tmp_path):
    """A campaign file with an oracle of its own beside it."""
    files = {
        "a.osc": 'import osc.helpers\n\nscenario nothing:\n    do serial:\n        log("done")\n',
        "a.vast": "version: 1\nmetadata: {name: a}\nconfiguration: [{name: all}]\n"
        "execution: {scenario_file: a.osc, runs: 1, timeout: 10}\nevaluation: {oracles: ['own.py:Quick']}\n",
        "own.py": OWN,
        "limits.py": "MOST_S = 5.0\n",
        "most.txt": "5",
    }
    (tmp_path / "here").mkdir()
    for name, text in files.items():
        (tmp_path / "here" / name).write_text(text)
    return tmp_path / "here" / "a.vast"


def found(file):
    campaign, oracles = read_campaign(file)
    return basis_of(campaign, oracles, inputs_of(campaign, oracles))


def test_a_campaign_follows_from_its_file_and_what_that_names():
    folder = CAMPAIGNS / "quickstart"
    files = [folder / "quickstart.vast", *(folder / "maps").iterdir()]
    basis = found(folder / "quickstart.vast")
    assert basis.read == {str(file): file_digest(file) for file in files}
    assert not basis.plug_ins
    assert {"vastflow", "numba", "numpy", "scipy", "matplotlib", "pyarrow"} <= {*basis.libraries}


def test_plug_ins_count_with_all_that_they_use(campaign):
    basis = found(campaign)
    folder = campaign.parent
    assert basis.plug_ins == [str(folder / "own.py")]
    assert basis.read == {
        str(folder / name): file_digest(folder / name)
        for name in ("a.vast", "a.osc", "own.py", "limits.py", "most.txt")
    }


def test_a_map_from_elsewhere_would_be_read_from_beside_the_file(tmp_path):
    maps = CAMPAIGNS / "quickstart" / "maps"
    (tmp_path / "here.vast").write_text((CAMPAIGNS / "quickstart" / "quickstart.vast").read_text())
    campaign, oracles = read_campaign(tmp_path / "here.vast", maps.parent)
    basis = basis_of(campaign, oracles, inputs_of(campaign, oracles))
    assert {Path(file).name for file, content in basis.read.items() if content is None} == {"office.yaml"}
    assert all(Path(file).parent != tmp_path / "maps" for file, content in basis.read.items() if content is not None)


def test_a_plug_in_that_uses_a_module_that_is_installed_nowhere_has_none(campaign, tmp_path, monkeypatch):
    (tmp_path / "live").mkdir()
    (tmp_path / "live" / "numbers_of_mine.py").write_text("ONE = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path / "live"))
    (campaign.parent / "own.py").write_text(f"import numbers_of_mine\n{OWN}")
    assert found(campaign) is None


def test_steps_over_results_have_none(campaign):
    (campaign.parent / "note.sh").write_text("exit 0\n")
    step = "results_processing: {postprocessing: [{command: {script: note.sh}}]}\n"
    campaign.write_text(campaign.read_text() + step)
    assert found(campaign) is None


def test_programs_have_none():
    assert found(CAMPAIGNS / "growth" / "growth.vast") is None


def test_a_notebook_has_none():
    assert found(CAMPAIGNS / "notebook" / "lost.vast") is None
