"""Proofs in short: planted truths are found at the stated rates, and reports of thousands of runs stay small."""

import json
import subprocess
import sys

import numpy as np
import planted_truths
import pytest
import truth_factors

pytestmark = pytest.mark.slow


PARTS = {"classes": 150, "factors": 40, "lengths": 40, "rare": 40, "stopping": 60, "comparison": 150}
PARTS |= {"gate_others": 60, "gate_these": 100}


@pytest.mark.parametrize(("part", "campaigns"), PARTS.items())
def test_planted_truths_are_found(part, campaigns):
    findings = list(getattr(planted_truths, part)(campaigns, np.random.default_rng(12)))
    assert findings
    assert [str(finding) for finding in findings if not finding.good] == []


@pytest.mark.parametrize("part", ["units", "trends", "metrics"])
def test_sentences_on_factors_survive_a_recount(part):
    found = list(truth_factors.figures([part], 30, seed=412))
    assert {figure.kind for figure in found} >= {"false"}
    assert [str(figure) for figure in found if not figure.good] == []


REPORT = """
import pathlib, sys
from vastflow.oracles.page.report import write_report

write_report(pathlib.Path(sys.argv[1]))
lines = pathlib.Path("/proc/self/status").read_text().splitlines()
print(next(line for line in lines if line.startswith("VmHWM")).split()[1])
"""
"""Print the peak memory (kB), which Linux does not keep from the parent as it does `ru_maxrss`."""


def test_report_of_2400_runs_stays_small(synthetic_campaign, room, build):
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
    rng = np.random.default_rng(7)
    for k in range(240):
        ways = np.linspace((1.0, 2.0), (5.0, 2.0), 200) + rng.normal(0.0, 0.02, (10, 200, 2))
        outcomes = np.where(np.arange(10) < k % 12, "aborted", "succeeded").tolist()
        synthetic_campaign.add(
            f"room-{k}",
            f"room-{k % 3}",
            room,
            task,
            recordings=[build.a_recording(ways[i], run_index=i, outcome=outcomes[i]) for i in range(10)],
            factors={"noise": k % 4, "drop": k % 5},
            provenance={"_path": ways[0, ::20].tolist(), "_path_length": 4.0},
            oracles=[(name, {}) for name in ("success", "performance", "robustness", "safety")],
        )
    directory = synthetic_campaign.write()
    done = subprocess.run([sys.executable, "-c", REPORT, str(directory)], check=True, stdout=subprocess.PIPE)
    assert int(done.stdout) < 1_000_000
    assert (directory / "report.html").stat().st_size < 12e6
    evidence = json.loads((directory / "evidence.json").read_text())
    assert len(evidence["all_oracles"]["configurations"]) == 240
