"""Proofs in short: planted truths are found at the stated rates, and reports of thousands of runs stay small."""

import json

import gate
import numpy as np
import planted_truths
import pytest
import report_scale

pytestmark = pytest.mark.slow


PARTS = {"classes": 150, "factors": 40, "lengths": 40, "rare": 40, "stopping": 60, "comparison": 150}


@pytest.mark.parametrize(("part", "campaigns"), PARTS.items())
def test_planted_truths_are_found(part, campaigns):
    findings = list(getattr(planted_truths, part)(campaigns, np.random.default_rng(12)))
    assert findings
    assert [str(finding) for finding in findings if not finding.good] == []


@pytest.mark.parametrize(("part", "campaigns"), [("others", 60), ("these", 100)])
def test_gate_passes_losses_as_rarely_as_stated(part, campaigns):
    findings = list(getattr(gate, part)(campaigns, np.random.default_rng(18)))
    assert [str(finding) for finding in findings if not finding.good] == []


def test_report_of_2400_runs_stays_small(tmp_path):
    report_scale.write_campaign(tmp_path / "robot", 240, 10)
    found = report_scale.measured(tmp_path / "robot")
    assert found["memory_mb"] < 1000
    assert found["report_mb"] < 12
    evidence = json.loads((tmp_path / "robot" / "evidence.json").read_text())
    assert len(evidence["all_oracles"]["configurations"]) == 240


def test_report_without_a_robot_has_no_maps(tmp_path):
    report_scale.write_campaign(tmp_path / "idle", 300, 20, robot=False)
    report_scale.measured(tmp_path / "idle")
    page = (tmp_path / "idle" / "report.html").read_text()
    assert 'id="maps"' not in page
    names = {file.stem for file in (tmp_path / "idle" / "figures").iterdir()}
    assert names == {"rates", "factors"}
