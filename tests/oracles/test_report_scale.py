"""The report of a campaign of thousands of runs, in short; `tests/proofs/report_scale.py` has the whole size."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PROOF = Path(__file__).parents[1] / "proofs" / "report_scale.py"


@pytest.fixture(scope="module")
def proof():
    spec = importlib.util.spec_from_file_location("report_scale", PROOF)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_report_of_2400_runs_stays_small(proof, tmp_path):
    proof.write_campaign(tmp_path / "robot", 240, 10)
    found = proof.measured(tmp_path / "robot")
    assert found["memory_mb"] < 1000
    assert found["report_mb"] < 12
    evidence = json.loads((tmp_path / "robot" / "evidence.json").read_text())
    assert len(evidence["all_oracles"]["configurations"]) == 240


def test_report_without_a_robot_has_no_maps(proof, tmp_path):
    proof.write_campaign(tmp_path / "idle", 300, 20, robot=False)
    proof.measured(tmp_path / "idle")
    page = (tmp_path / "idle" / "report.html").read_text()
    assert 'id="maps"' not in page
    names = {file.stem for file in (tmp_path / "idle" / "figures").iterdir()}
    assert names == {"rates", "factors"}
