"""Hostile campaign directories: whatever of them is executed leaves a line in a file."""

import json
import re
from dataclasses import replace
from pathlib import Path

from synthetic import SyntheticCampaign, a_recording, walled_room, write_map

from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.results.events import EVENTS
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.kernels.streams import run_entropy
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.world.world import map_content

PAGE = (Path(__file__).parents[2] / "docs" / "write-a-controller.md").read_text()
CONTROLLER = dict(re.findall(r"^```\w+ (my_pursuit\.\w+)\n((?:.*\n)*?)^```$", PAGE, re.MULTILINE))
SHADOWS = ("json", "pickle", "argparse", "logging", "struct", "tempfile")
"""Modules of Python that its own start does not import."""
RADIUS_M = 0.17
ROBOT = f"local_costmap: {{local_costmap: {{ros__parameters: {{robot_radius: {RADIUS_M}}}}}}}\n"
TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
CAMPAIGN = """\
version: 1
metadata: {name: stranger}
configuration:
  - {name: room, parameters: [map_file: room/map.yaml, start_pose: {x: 1.0, y: 2.0}, goal_pose: {x: 5.0, y: 2.0}]}
execution: {runs: 1, timeout: 3, nav2_params: my_pursuit.yaml}
"""


def touching(canary):
    """Return a line of Python that is seen when it is executed."""
    return f"open({str(canary)!r}, 'a').write(__name__ + '\\n')\n"


def executed(canary):
    """Return the names of modules that were executed, and forget them."""
    found = canary.read_text().split() if canary.exists() else []
    canary.unlink(missing_ok=True)
    return found


def shadowed(folder, canary):
    """Write modules that shadow Python's own for a process that imports from its working directory."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in SHADOWS:
        (folder / f"{name}.py").write_text(touching(canary))
    return folder


def stranger(results, canary, *, day=20, plug_in=True):
    """Write a finished campaign of one lost run whose controller is a plug-in that leaves a line."""
    directory = results / f"stranger-2026-11-{day}-060000"
    inputs = shadowed(directory, canary) / "inputs"
    inputs.mkdir()
    room = write_map(results.parent / f"room-{day}" / "room", walled_room(6.0, 4.0))
    system = {}
    if plug_in:
        for name, text in CONTROLLER.items():
            (inputs / name).write_text(touching(canary) + text if name.endswith(".py") else text + ROBOT)
        system = {"nav2_params": nav2_file(inputs / "my_pursuit.yaml")}
    campaign = SyntheticCampaign(directory)
    environment = {"map_file": map_content(room), "static_objects": []}
    scenario = Scenario("builtin:navigate_to_pose", 60.0, environment, TASK, system)
    seed = ":".join(f"{part:x}" for part in run_entropy(0, scenario.situation_digest, 0))
    walk = [(1.0 + 0.1 * k, 2.0) for k in range(20)]
    recording = a_recording(walk, run_index=0, outcome="aborted", reason="stuck")
    lost = replace(recording, run=replace(recording.run, seed=seed))
    campaign.add("room", "room", room, TASK, recordings=[lost], factors={"noise": 0.1}, system=system)
    for row in campaign.configurations:
        row |= {"checked_digest": row["scenario_digest"], "timeout_s": 60.0}
    stages = ("instantiate", "execute", "observe", "judge")
    source = {stage: {"files": {}, "libraries": {}} for stage in stages}
    asked = {"file": "stranger.vast", "runs": 1, "only": [], "places": {}, "sample": None}
    counts = {"configurations": 1, "runs": 1, "rejected": 0, "passed": 0, "failed": 1, "not_judged": 0}
    campaign.metadata |= {"source": dict.fromkeys(source, "1"), "numeric_class": "x", "seed": 0, "code": source}
    campaign.metadata |= {"oracles": [], "producers": {}, "name": "stranger", "created": f"2026-11-{day}T06:00:00"}
    campaign.metadata |= {"counts": counts, "asked": asked}
    campaign.write(CAMPAIGN if plug_in else CAMPAIGN.replace(", nav2_params: my_pursuit.yaml", ""))
    for file in room.parent.iterdir():
        (inputs / "room").mkdir(exist_ok=True)
        (inputs / "room" / file.name).write_bytes(file.read_bytes())
    write_wide(directory, wide_table(read_tables(directory)))
    canary.unlink(missing_ok=True)
    return directory


def unfinished_stranger(results, canary):
    """Write the folder of a campaign that seems to run, and names files, folders, and a store of its own."""
    place = shadowed(results / ".living-2026-11-21-060000.running", canary)
    (place / "living.vast").write_text(CAMPAIGN)
    told = {"name": "living", "file": str(place / "living.vast"), "folder": str(place)}
    told |= {"request": {"campaign": "living.vast", "store": str(place / "store")}}
    (place / EVENTS).write_text(json.dumps({"at": "2026-11-21T06:00:00+00:00", "event": "began", **told}) + "\n")
    return place
