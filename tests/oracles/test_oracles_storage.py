"""Size of the recording and trace of a configuration on disk."""

from pathlib import Path
from typing import Final

import numpy as np

from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.observation.trace import trace_of
from vastflow.sim.model.blocks import read_block, read_recordings, write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.run import run
from vastflow.sim.world.map_file import load_map

OFFICE: Final = Path(__file__).parents[2] / "campaigns" / "quickstart" / "maps" / "office.yaml"
RUNS: Final = 20
LIMIT_BYTES: Final = 180_000
"""Of a configuration of 20 runs of 60 s, a row each 0.1 s."""


def a_scenario() -> Scenario:
    """About 20 s under scan noise, past a standing box and one that appears."""
    box = {"model": "box", "xacro_arguments": "width:=0.4, length:=0.4"}
    trigger = {"point": {"x": 5.0, "y": 5.0}, "threshold": 1.5}
    return Scenario(
        "builtin:navigate_to_pose",
        60.0,
        {
            "map_file": FileContent(str(OFFICE), load_map(OFFICE).digest),
            "static_objects": [
                {**box, "entity_name": "stands", "spawn_pose": {"x": 3.0, "y": 5.8}},
                {**box, "entity_name": "appears", "spawn_pose": {"x": 5.0, "y": 5.4}, "spawn_trigger": trigger},
            ],
        },
        {"start_pose": {"x": 1.0, "y": 5.0}, "goal_pose": {"x": 8.0, "y": 3.0}},
        {"laserscan_gaussian_noise_std_deviation": 0.1},
    )


def test_blocks_of_twenty_runs_are_small_and_lossless() -> None:
    scenario = a_scenario()
    recordings = [run(scenario, index) for index in range(RUNS)]
    recorded = write_recordings(recordings)
    observed = observe_block(scenario, recorded)
    rows = sum(len(recording.columns["t_ms"]) for recording in recordings)
    # These runs are shorter, and what is fixed of a file is not.
    assert len(recorded) + len(observed) < LIMIT_BYTES * rows / (RUNS * 600)
    for written, read, (row, derived) in zip(recordings, read_recordings(recorded), read_block(observed), strict=True):
        assert read.run == written.run
        np.testing.assert_equal(read.columns, written.columns)
        trace = trace_of(read, row, derived)
        np.testing.assert_array_equal(np.rint(trace["x_m"] * 1000), written.columns["x_mm"])
        assert {"localization_error_m", "wall_clearance_m", "static_clearance_m", "deviation_m"} <= trace.columns.keys()
    assert rows > RUNS * 150
