"""Campaigns paced by the host's clock: workers, health in the report, and runs that count."""

import html
import json
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from room import drawn_room

from vastflow.flows import run_campaign
from vastflow.flows.results.tables import KeptLogs
from vastflow.oracles.evidence.headline import percent_text
from vastflow.tasks.engine import pace

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

CAMPAIGN = """\
version: 1
metadata: {{name: paced}}
configuration:
  - name: ahead
    parameters:
      - map_file: room.yaml
      - start_pose: {{x: 1.0, y: 1.0, yaw: 0.0}}
      - goal_pose: {{x: 2.5, y: 1.0, yaw: 0.0}}
execution:
  system: ros2
  nodes: [{{stays: {{command: sleep 600}}}}]
  ros2: {{python: {bridge}, time: paced, real_time_factor: 2, mission: topic, most_late: {most_late}, most_waiting: 1}}
  runs: {runs}
  timeout: {timeout}
"""
BRIDGE = Path(__file__).parents[1] / "support" / "false_bridge.py"


@pytest.fixture
def campaign(flow_folder, monkeypatch):
    """Run a campaign by two workers where no run fits, and return what was said too."""
    monkeypatch.setattr(pace, "PACED_SHARE", 0.001)
    drawn_room(flow_folder / "campaign")

    def run(runs, most_late, timeout=8):
        file, said = flow_folder / "campaign" / "paced.vast", []
        file.write_text(CAMPAIGN.format(bridge=BRIDGE, runs=runs, most_late=most_late, timeout=timeout))
        observer = SimpleNamespace(update=lambda progress: said.extend(progress.notices))
        places = {name: flow_folder / f"{name} {most_late}" for name in ("store", "results")}
        return run_campaign(file, workers=2, observer=observer, **places), [*dict.fromkeys(said)]

    return run


def test_paced_campaign_counts_its_runs_alone(campaign):
    found, said = campaign(2, 1)
    (line,) = said
    assert re.fullmatch(
        r"1 worker, as a paced run takes [\d.]+ of \d+ cores\. Runs may be late, and are not judged then", line
    )
    summary = found.summary
    assert (summary.runs, summary.executed, summary.passed) == (2, 2, 2)
    directory = found.directory
    told = json.loads((directory / "metadata.json").read_text())["health"]
    report = html.unescape((directory / "report.html").read_text())
    assert told in report, [line for line in report.splitlines() if "paced at" in line]
    healths = [row["health"] for row in KeptLogs(directory).of("ahead")]
    late, ticks = (sum(each[name] for each in healths) for name in ("late_ticks", "ticks"))
    waited = max(each["waited"] for each in healths)
    assert told == (
        f"2 runs paced at 2 times real time: {percent_text(late / ticks)} of ticks late, threads waited {waited:.0%} of the time "
        "for a CPU at most, 2 control loops missed by the nodes' own words"
    )
    again, said = campaign(2, 1)
    assert (again.summary.executed, again.summary.reused, said) == (0, 2, [])  # and is not probed
    more, said = campaign(3, 1)
    assert (more.summary.executed, more.summary.reused, len(said)) == (1, 2, 1)


def test_late_runs_never_count_as_failed(campaign, monkeypatch):
    monkeypatch.setenv("BEHAVIOR", "slow")
    found, _ = campaign(2, 0.02, timeout=1)
    assert (found.summary.failed, found.summary.not_judged, len(found.faults)) == (0, 2, 2)
    told = json.loads((found.directory / "metadata.json").read_text())["health"]
    assert told == "0 runs paced at 2 times real time; 2 runs not judged, as the host was late"
