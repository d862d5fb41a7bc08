"""Recorded runs of a campaign directory, ready to be executed again."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from vastflow.oracles.judgment.verdict import Judgment, run_judgment
from vastflow.oracles.results.executed import KeptFiles, configuration_row, recordings_of, scenario_of_row
from vastflow.oracles.results.schema import read_columns
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.kernels.streams import run_entropy
from vastflow.sim.model.files import read_json
from vastflow.sim.model.recording import Recording
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.plug_ins.loading import code_from, snapshot_behind
from vastflow.sim.reading.checked import checked_of
from vastflow.sim.scenario.programs.actions import PROCESSES


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recorded run.

    Attributes:
        configuration: The executed one; a duplicate's original.
        seed: The campaign's `execution.seed`.
        judgment: Judgment of all oracles together.
        metadata: `metadata.json` of the campaign.
    """

    configuration: str
    scenario: Scenario
    recording: Recording = field(repr=False)
    seed: int
    judgment: Judgment
    metadata: Mapping[str, Any] = field(repr=False)


def recorded_run(directory: Path, configuration: str, run_index: int) -> RecordedRun:
    """Read one run from the campaign directory alone.

    Raises:
        UnusableDirectory: an unknown configuration or run; a missing, unreadable, or changed file.
    """
    with reading(directory):
        row = configuration_row(directory, configuration)
        name = row["duplicate_of"] or configuration
        recording = _recording(directory, name, run_index)
        scenario = scenario_of_row(row, KeptFiles(directory, plug_ins=True))
        if scenario.digest != row["scenario_digest"]:
            found = f"{scenario.digest[:12]}…, recorded was {row['scenario_digest'][:12]}…"
            raise ValueError(f"the scenario of {row['name']} has digest {found}")
        # The campaign's seed is the first part of the run's entropy, whose rest follows from scenario and run.
        entropy = [int(part, 16) for part in recording.run.seed.split(":")]
        if entropy != run_entropy(entropy[0], scenario.situation_digest, run_index):
            raise ValueError(f"the seed {recording.run.seed} in the recording is not this scenario's")
        table = read_columns(directory / "verdicts.parquet")
        own = pc.and_(pc.equal(table["configuration"], name), pc.equal(table["run_index"], run_index))
        judgment = run_judgment(table.filter(own)["judgment"].to_pylist())
        metadata: dict[str, Any] = read_json(directory / "metadata.json")
        if missing := [key for key in ("name", "created", "vastflow", "versions", "host") if key not in metadata]:
            raise ValueError(f"metadata.json has no {', '.join(missing)}")
        return RecordedRun(name, scenario, recording, entropy[0], judgment, metadata)


def needs_code(recorded: RecordedRun) -> bool:
    """Whether executing a run may execute plug-ins or programs of the campaign; nothing is executed to tell."""
    try:
        with code_from(()):
            checked = checked_of(recorded.scenario)
    except ValueError:
        return True
    stack = checked.robot and checked.robot.parameters
    parts = (stack.controller, stack.planner, stack.lidar_noise) if stack else ()
    is_own = any(snapshot_behind(type(each)) for each in parts)  # known in this process from before
    return is_own or checked.programs is not None or not checked.actions.isdisjoint(PROCESSES)


def _recording(directory: Path, name: str, run_index: int) -> Recording:
    recordings = recordings_of(directory, name)
    if not recordings:
        raise UnusableDirectory(f"{directory}: no run of {name} was recorded. `vastflow show` says why.")
    if run_index not in recordings:
        known = list(map(str, sorted(recordings)))
        if len(known) > 8:
            known = [*known[:7], f"… {known[-1]} ({len(known)} in all)"]
        raise UnusableDirectory(f"{directory}: no run {run_index} of {name}. It has {', '.join(known)}")
    return recordings[run_index]
