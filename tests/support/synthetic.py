"""Small campaign directories with hand-built recordings."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.judgment.verdict import metrics_text
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.results.schema import CONFIGURATIONS, JUDGED_RUNS, REJECTIONS, VERDICTS, json_text, write_table
from vastflow.sim.loop.standstill import STOOD_STILL
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Recording, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.world.world import map_content

RESOLUTION_M = 0.05


def write_map(directory: Path, cells: np.ndarray, origin_xy_m: tuple[float, float] = (0.0, 0.0)) -> Path:
    """A trinary map of (H, W) cells, row 0 at the lowest y: 0 free, 100 occupied, -1 unknown."""
    directory.mkdir(parents=True, exist_ok=True)
    gray = np.select([cells == 0, cells == 100], [254, 0], 205).astype(np.uint8)
    Image.fromarray(gray[::-1]).save(directory / "map.pgm")
    x, y = origin_xy_m
    (directory / "map.yaml").write_text(
        f"image: map.pgm\nresolution: {RESOLUTION_M}\norigin: [{x}, {y}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return directory / "map.yaml"


def walled_room(width_m: float, height_m: float) -> np.ndarray:
    """Free cells with a wall one cell thick round them."""
    cells = np.zeros((round(height_m / RESOLUTION_M), round(width_m / RESOLUTION_M)), dtype=np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    return cells


def a_recording(
    xy_m, *, run_index=0, outcome="succeeded", reason="", error_xy_m=(0.0, 0.0), missed_goals=0, events=()
) -> Recording:
    """A run along `xy_m` at a row every 0.1 s, its estimate wrong by `error_xy_m`."""
    xy = np.asarray(xy_m, dtype=np.float64).reshape(-1, 2)
    n = len(xy)

    def fixed(values: Any) -> np.ndarray:
        return np.rint(np.broadcast_to(np.asarray(values, dtype=np.float64), (n,)) * 1000).astype(np.int32)

    columns = {
        "t_ms": fixed(np.arange(n) * 0.1),
        **{name: fixed(values) for name, values in (("x_mm", xy[:, 0]), ("y_mm", xy[:, 1]), ("yaw_mrad", 0.0))},
        "estimated_x_mm": fixed(xy[:, 0] + error_xy_m[0]),
        "estimated_y_mm": fixed(xy[:, 1] + error_xy_m[1]),
        **{name: fixed(0.5) for name in ("speed_mmps", "command_speed_mmps")},
        **{name: fixed(0.0) for name in ("estimated_yaw_mrad", "yaw_rate_mradps", "command_yaw_rate_mradps")},
        "localized": np.ones(n, dtype=np.int32),
    }
    distance_m = float(np.hypot(*np.diff(xy, axis=0).T).sum())
    error_code = 0 if outcome == "succeeded" else 205
    run: Any = (run_index, "1-2-3", outcome, error_code, reason, n * 0.1, distance_m, 0, missed_goals, events)
    return Recording(Run(*run), columns)


def box_at(x_m: float, y_m: float, edge_m: float = 0.5) -> dict[str, Any]:
    """A cube as `ObstacleVariation` writes it."""
    return {
        "entity_name": f"box_{x_m:g}_{y_m:g}",
        "model": "file:///models/box.sdf.xacro",
        "spawn_pose": {"position": {"x": x_m, "y": y_m}, "orientation": {"yaw": 0.0}},
        "xacro_arguments": f"width:={edge_m}, length:={edge_m}, height:=1.0",
    }


@dataclass
class SyntheticCampaign:
    """A campaign directory in the making: rows are collected, `write` lays them out."""

    directory: Path
    metadata: dict[str, Any] = field(default_factory=dict)
    configurations: list[dict[str, Any]] = field(default_factory=list)
    rejections: list[dict[str, Any]] = field(default_factory=list)
    runs: list[dict[str, Any]] = field(default_factory=list)
    verdicts: list[dict[str, Any]] = field(default_factory=list)

    def add(
        self, name, family, map_file, task, *, recordings=(), obstacles=(), factors=None, oracles=(), duplicate_of=None,
        fault=None, runs=0, provenance=None, system=None,
    ) -> None:  # fmt: skip
        """A configuration, its recordings judged by `oracles`; with `fault` its `runs` are not judged."""
        file = map_content(map_file)
        environment = {"map_file": file, "static_objects": list(obstacles)}
        scenario = Scenario("builtin:navigate_to_pose", 60.0, environment, task, system or {})
        steps = [{"producer": "P", "keys": [key, *(provenance or {})]} for key in factors or {}]
        row = {
            "name": name,
            "family": family,
            "duplicate_of": duplicate_of,
            "environment": file.digest,
            "scenario_digest": scenario.digest,
            "abstract": scenario.abstract,
            "scenario": json_text({"environment": environment, "task": task, "system": system or {}}),
            "factors": json.dumps(factors or {}),
            "provenance": json.dumps(provenance or {}),
            "steps": json.dumps(steps),
        }
        self.configurations.append(row)
        if duplicate_of is not None:
            return
        judges = oracles_of(oracles)
        if fault is not None:
            for run_index, judge in product(range(runs), judges):
                self._verdict(name, family, run_index, judge.name, "not judged", fault)
            return
        shutil.copytree(map_file.parent, self.directory / "environments" / file.digest, dirs_exist_ok=True)
        block = write_recordings(recordings)
        traces = observe_block(scenario, block)
        for folder, content in (("recordings", block), ("traces", traces)):
            (self.directory / folder).mkdir(parents=True, exist_ok=True)
            (self.directory / folder / f"{name}.parquet").write_bytes(content)
        judged = judge_block(scenario, block, traces, judges)
        for verdict in judged.verdicts:
            said = verdict.oracle, verdict.judgment, verdict.reason, metrics_text(verdict.metrics)
            self._verdict(name, family, verdict.run_index, *said)
        for run in (recording.run for recording in recordings):
            row = {"configuration": name, "family": family, **{key: getattr(run, key) for key in _RUN_COLUMNS}}
            row["contacts"] = sum(event.kind == "contact" for event in run.events)
            row["stood_still"] = next((event.what for event in run.events if event.kind == STOOD_STILL), None)
            self.runs.append({**row, "cause": judged.causes.get(run.run_index)})

    def reject(self, family: str, reason: str, requested: Mapping[str, Any]) -> None:
        """A rejected instance."""
        row = {"family": family, "parent": family, "producer": "PathVariationRandom", "reason": reason}
        self.rejections.append({**row, "requested": json.dumps(requested), "inputs": "{}"})

    def write(self, campaign_text: str = "version: 1\n") -> Path:
        """Lay the directory out."""
        self.directory.mkdir(parents=True, exist_ok=True)
        (self.directory / "campaign.vast").write_text(campaign_text)
        metadata = {
            "name": "synthetic",
            "created": "2026-11-21T06:00:00",
            "vastflow": "0.1.0",
            "versions": {"python": "3.11.2", "numpy": "2.4.6"},
            "host": {"name": "lab", "machine": "x86_64", "cpus": 2},
            "counts": {},
            "notes": [],
            "faults": [],
            **self.metadata,
        }
        (self.directory / "metadata.json").write_text(json.dumps(metadata))
        schemas = {
            "configurations": CONFIGURATIONS,
            "rejections": REJECTIONS,
            "runs": JUDGED_RUNS,
            "verdicts": VERDICTS,
        }
        for table, schema in schemas.items():
            write_table(self.directory / f"{table}.parquet", schema, getattr(self, table))
        return self.directory

    def _verdict(self, *values):
        self.verdicts.append(dict(zip(VERDICTS.names, (*values, "{}")[:7], strict=True)))


_RUN_COLUMNS = (
    *("run_index", "seed", "outcome", "error_code", "reason"),
    *("simulated_s", "distance_m", "recoveries", "missed_goals"),
)
