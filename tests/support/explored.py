"""Campaign directories for an explorer, and the addresses of all that it shows of one."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from starlette.testclient import TestClient
from synthetic import SyntheticCampaign, a_recording

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.server import application
from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.model.recording import Recording

TOKEN: Final = "a-token-of-the-tests"
PLACE: Final = "http://127.0.0.1:8000"
CAMPAIGN: Final = """\
version: 1
metadata: {name: office}
execution:
  runs: 4
"""
WALK: Final = [(1.0 + 0.1 * i, 2.0) for i in range(41)]


def write_explored(
    results: Path, room: Path, day: int, families: dict[str, list[int]], *, name: str = "office", text: str = CAMPAIGN
) -> Path:
    """Write the campaign of a day.

    Its configurations are `KEY-1` … of families, each with as many of its four runs lost as listed. Families' names have different lengths.
    """
    campaign = SyntheticCampaign(results / f"{name}-2026-11-{day:02}-060000")
    passed = failed = 0
    for family, losses in families.items():
        for k, lost in enumerate(losses, start=1):
            runs = [recorded(i, i < lost) for i in range(4)]
            passed, failed = passed + 4 - lost, failed + lost
            goal = {"x": 5.0 - 0.1 * k, "y": 1.0 + 0.1 * len(family)}  # no two alike
            task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": goal}
            campaign.add(f"{family}-{k}", family, room, task, recordings=runs, factors={"noise": 0.1 * k})
    for row in campaign.configurations:
        row["checked_digest"] = row["scenario_digest"]
    counts = {"configurations": len(campaign.configurations), "runs": passed + failed, "rejected": 0}
    counts |= {"passed": passed, "failed": failed, "not_judged": 0}
    stages = ("instantiate", "execute", "observe", "judge")
    source = {stage: {"files": {}, "libraries": {}} for stage in stages}
    campaign.metadata |= {"source": dict.fromkeys(source, "1"), "numeric_class": "x", "seed": 0, "code": source}
    campaign.metadata |= {"oracles": [], "name": name, "created": f"2026-11-{day:02}T06:00:00", "counts": counts}
    directory = campaign.write(text)
    write_wide(directory, wide_table(read_tables(directory)))
    return directory


def recorded(run_index: int, lost: bool) -> Recording:
    """A run through the room with a seed of its own, which stops half way if it is lost."""
    walk = WALK[:20] if lost else WALK
    outcome, reason = ("aborted", "stuck") if lost else ("succeeded", "")
    found = a_recording(walk, run_index=run_index, outcome=outcome, reason=reason)
    return replace(found, run=replace(found.run, seed=f"1-2-{run_index}"))


def explorer_of(*roots: Path) -> TestClient:
    """A client without the token; it follows no redirect."""
    app = application(Directories(roots), TOKEN)
    return TestClient(app, PLACE, raise_server_exceptions=False, follow_redirects=False)


def addresses_of(id: str, beside: str, environment: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield paths and queries of all pages of a campaign whose first configuration is `room-1`, and of their parts.

    Args:
        beside: The id of another campaign, to compare with.
        environment: The digest of its map.
    """
    of = {"c": id}
    yield from ((f"/{page}", of) for page in ("campaign", "live"))
    yield from ((f"/api/{view}", of) for view in ("summary", "facets", "rows", "points", "table"))
    yield "/api/table", {**of, "format": "parquet"}
    yield "/api/paths", {**of, "environment": environment}
    yield "/api/points", {**of, "column": ["noise", "simulated_s"]}
    configuration = {**of, "name": "room-1"}
    yield from (
        (place, configuration) for place in ("/configuration", "/api/configuration", "/api/configuration/paths")
    )
    yield "/api/configuration/signals", {**configuration, "signal": "speed_mps", "over": "distance_m"}
    run = {**of, "configuration": "room-1", "run": 0}
    yield from (("/run", run), ("/api/frames", run))
    yield "/run", {"c": beside, "configuration": "room-1", "run": 0, "with": "room-1", "withrun": 0, "withc": id}
    yield from (("/compare", {"a": beside, "b": id}), ("/compare", {"a": id, "b": beside}))
