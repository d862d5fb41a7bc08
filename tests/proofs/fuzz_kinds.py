"""Kinds of files that are fuzzed: their seeds, and the command that reads one."""

import json
import random
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from fuzz_mutants import (
    Mutator,
    bytes_changed,
    json_tree,
    lines_changed,
    picture_changed,
    tokens_changed,
    yaml_tree,
)
from PIL import Image

ROOT: Final = Path(__file__).parents[2]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        seeds: Files below the folder that mutants are made in.
        command: Arguments of vastflow for a mutant.
    """

    name: str
    seeds: Sequence[Path]
    mutators: tuple[Mutator, ...]
    command: Callable[[Path, random.Random], list[str]]


PROBES: Final = {
    "every.vast": """
version: 1
metadata: {name: every, title: A title}
constraints: [{near: "straight_distance < 9"}]
configuration:
  - name: rooms
    parameters: [{map_file: map.yaml}, {inflation_radius: 0.3}]
    variations:
      - PathVariationRandom: {path_length: [0.8, 1.0], path_length_tolerance: 0.5, num_paths: 1, min_distance: 0.2,
          start_pose: "@start_pose", goal_poses: "@goal_poses", num_goal_poses: 2, robot_diameter: 0.2, seed: 3}
      - ObstacleVariation: {obstacle_configs: [{amount: 1, max_distance: 0.3, xacro_arguments: "width:=0.1, length:=0.1"}],
          count: 1, robot_diameter: 0.1}
      - ParameterVariationList: {name: robot.max_speed, values: [0.1, 0.5]}
    design: {t_way: {strength: 2}}
    dimensions: {inflation_radius: system}
  - name: raster
    parameters: [{map_file: map.yaml}]
    variations:
      - PathVariationRasterized: {raster_size: 0.8, path_length: 1.0, robot_diameter: 0.2}
      - OneOfVariation: {variations: [{ParameterVariationDistributionUniform: {name: a, min: 0, max: 1, num_variations: 2}},
          {ParameterVariationDistributionGaussian: {name: a, mean: 0, std: 1, num_variations: 2, seed: 1, type: int}}]}
    constraints: {few: "abs(a) < 3 and clearance > -1"}
execution:
  runs: {min: 2, max: 5, stop: {error: 0.05}}
  seed: 7
  timeout: 30.0
  nav2_params: nav2.yaml
  env: [{A: b}]
evaluation:
  oracles: [performance, {safety: {}}, {judge.ipynb: {}}]
""",
    "plans.vast": """
version: 1
configuration:
  - name: plans
    parameters: [{start_pose: {position: {x: 1, y: 1}, orientation: {yaw: 0}}}, {goal_pose: {x: 2, y: 1, yaw: 0}}]
    variations:
      - FloorplanVariation: {variation_files: [p.variation], num_variations: 1, seed: 1}
      - ParameterVariationList: {name: [laser_scan_gaussian_noise_std, robot_radius], values: [[0.1, 0.2], [0.2, 0.3]]}
execution: {runs: 1, scenario_file: "builtin:navigate_to_pose"}
""",
    "map.yaml": "image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.0, -1.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n",
    "scale.yaml": "{image: map.png, mode: scale, resolution: 5e-2, origin: [0, 0], negate: true, occupied_thresh: .8, free_thresh: .1}\n",
    "nav2.yaml": """
amcl:
  ros__parameters: {alpha1: 0.2, laser_model_type: "likelihood_field", max_particles: 500, use_sim_time: true}
controller_server:
  ros__parameters:
    controller_frequency: 20.0
    controller_plugins: ["FollowPath"]
    FollowPath: {plugin: "nav2_mppi_controller::MPPIController", time_steps: 56, critics: [GoalCritic], GoalCritic: {cost_weight: 5.0}}
local_costmap: {local_costmap: {ros__parameters: {footprint: "[[0.1, 0.1], [0.1, -0.1], [-0.1, 0.0]]", plugins: [], width: 3}}}
""",
    "own.osc": """import osc.helpers
import osc.nav2
import osc.ros
enum side: [left, right = 4]
struct box:
    width: length = 0.5m
scenario own:
    timeout(60s)
    speeds: list of speed = [0.1mps, 2 * 0.2mps]
    where: box with:
        keep(it.width == 1.0m)
    robot: differential_drive_robot
    do parallel:
        serial:
            wait elapsed(1s)
            repeat(2)
            one_of:
                wait elapsed(2s)
                wait elapsed(3s)
        inner: serial:
            robot.nav_to_pose(pose_3d(position_3d(x: 1.0m, y: 2.0m), orientation_3d(yaw: 90deg))) with:
                timeout(5s)
            emit end
""",
    "judge.ipynb": json.dumps(
        {
            "cells": [
                {"cell_type": "markdown", "metadata": {}, "source": ["# words"]},
                {"cell_type": "code", "metadata": {"tags": ["parameters"]}, "source": ["limit = 0.5\n", "names = ['a']"],
                 "outputs": [], "execution_count": 1},
                {"cell_type": "code", "metadata": {"tags": ["skip-execution"]}, "source": "%matplotlib inline", "outputs": []},
                {"cell_type": "code", "metadata": {}, "source": ["metrics = {'way': 'm'}\n", "verdicts = []\n", "for run in runs: pass"],
                 "outputs": [{"output_type": "stream", "name": "stdout", "text": ["x"]}]},
            ],
            "metadata": {"kernelspec": {"name": "python3", "language": "python", "display_name": "p"}},
            "nbformat": 4, "nbformat_minor": 5,
        }
    ),
}  # fmt: skip


def laid_out(folder: Path) -> None:
    """Copy the shipped campaigns into `folder`, and write the probes beside them: small, and with every kind of thing."""
    shutil.copytree(ROOT / "campaigns", folder / "campaigns", ignore=shutil.ignore_patterns("__pycache__"))
    probes = folder / "probes"
    probes.mkdir()
    for name, text in PROBES.items():
        (probes / name).write_text(text, encoding="utf-8")
    example = ROOT / "tests" / "producers"
    (probes / "p.variation").write_text(
        (example / "test_floorplan_example.variation").read_text().replace("test_floorplan_example", "p")
    )
    shutil.copy(example / "test_floorplan_example.fpm", probes / "p.fpm")
    cells = np.full((60, 60), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[20:40, 30] = 0
    gray = Image.fromarray(cells)
    gray.save(probes / "map.pgm")
    gray.save(probes / "map.bmp")
    gray.convert("RGBA").save(probes / "map.png")
    gray.convert("P").save(probes / "palette.png")
    gray.convert("1").save(probes / "bits.png")
    Image.fromarray((cells[:20, :20] * 257.0).astype(np.uint16)).save(probes / "deep.png")
    rows = "\n".join(" ".join(map(str, row)) for row in cells[:20, :20].tolist())
    (probes / "plain.pgm").write_text(f"P2\n# words\n20 20\n255\n{rows}\n")
    _campaign_directory(probes / "every.vast", folder / "results")


def _campaign_directory(file: Path, results: Path) -> None:
    from whole_directory import ConfigurationResult, write_results

    from vastflow.flows.request.campaign_file import read_campaign
    from vastflow.oracles.judgement.verdict import Metric, Verdict
    from vastflow.tasks.keys.source import installed_tree

    verdicts = [
        Verdict(oracle.name, k, "fail" if k == 1 else "pass", "1.2 m off" * (k == 1), {"way": Metric(1.5, "m")})
        for k in range(3)
        for oracle in read_campaign(file)[1]
    ]
    written = write_results(file, results, ConfigurationResult(verdicts=verdicts), runs=3, tree=installed_tree())
    metadata = written.directory / "metadata.json"  # the same in whatever folder, so that mutants are
    metadata.write_text(metadata.read_text().replace(str(results.parent), "/campaigns"))


def _directory_command(file: Path, rng: random.Random) -> list[str]:
    """Return a reader of the campaign directory that contains `file`."""
    directory = next(
        parent for parent in file.parents if (parent / "configurations.parquet").exists() or parent.name == "mutant"
    )
    return rng.choice(
        (
            ["show", str(directory)],
            ["export", str(directory), str(directory.with_name("exported"))],
            ["compare", str(directory), str(directory)],
            ["plan", str(directory), "rooms-1-1-1"],
            ["show", "--coverage", str(directory)],
            ["replay", str(directory), "rooms-1-1-1", "1"],
            ["plan", "--since", str(directory), str(directory.parents[1] / "probes" / "every.vast")],
        )
    )  # fmt: skip


def kinds(folder: Path) -> list[Kind]:
    """All kinds; `folder` was laid out."""

    def found(pattern: str) -> list[Path]:
        """Seeds of a kind: no mutant of an earlier call."""
        paths = sorted(path for path in folder.rglob(pattern) if "results" not in path.parts)
        return [path for path in paths if "mutant" not in path.name]

    def words(*patterns: str) -> Mutator:
        """Tokens of all files of a kind, for one that is changed."""
        texts = " ".join(path.read_text() for pattern in patterns for path in found(pattern))
        return tokens_changed(tuple(sorted(set(texts.split())))[:600])

    def beside(name: str) -> Callable[[Path, random.Random], list[str]]:
        """A campaign file that names the mutant, to validate."""

        def command(file: Path, rng: random.Random) -> list[str]:
            campaign = file.with_name("of_mutant.vast")
            campaign.write_text(name.replace("MUTANT", file.name))
            return ["validate", str(campaign)]

        return command

    family = "configuration: [{name: a, parameters: [%s{start_pose: {x: 1, y: 1, yaw: 0}}, {goal_pose: {x: 2, y: 1, yaw: 0}}]}]\n"
    with_map = family % "{map_file: MUTANT}, "

    def pictured(file: Path, rng: random.Random) -> list[str]:
        header = file.with_name("of_mutant.yaml")
        mode = rng.choice(("trinary", "scale", "raw"))
        header.write_text(f"{{image: {file.name}, mode: {mode}, resolution: 0.05, origin: [0, 0, 0]}}")
        return beside(with_map.replace("MUTANT", "of_mutant.yaml"))(file, rng)

    text = (bytes_changed, lines_changed)
    results = next((folder / "results").iterdir())
    recorded = [results / name for name in ("metadata.json", "coverage.json", "configurations.parquet", "verdicts.parquet",
                                            "runs.parquet", "rejections.parquet", "campaign.vast", "evidence.json")]  # fmt: skip

    def plan(file: Path, rng: random.Random) -> list[str]:
        draw = ["render", "--resolution", "0.25", "--out", str(file.with_name("drawn"))]
        return ["floorplan", *(draw if rng.random() < 0.05 else ["geometry"]), str(file)]

    return [
        Kind("vast", found("*.vast"), (*text, words("*.vast"), yaml_tree, yaml_tree), lambda file, rng: ["validate", str(file)]),
        Kind("osc", found("*.osc"), (*text, words("*.osc")),
             lambda file, rng: ["scenario", rng.choice(("check", "parameters")), str(file)]),
        Kind("fpm", found("*.fpm"), (*text, words("*.fpm")), plan),
        Kind("variation", found("*.variation"), (*text, words("*.variation")),
             lambda file, rng: ["floorplan", "variations", str(file), "--out", str(file.with_name("drawn"))]),
        Kind("map", [folder / "probes" / name for name in ("map.yaml", "scale.yaml")],
             (*text, words("map.yaml", "scale.yaml"), yaml_tree, yaml_tree), beside(with_map)),
        Kind("picture", [folder / "probes" / name for name in ("map.pgm", "map.bmp", "map.png", "palette.png", "bits.png", "deep.png", "plain.pgm")],
             (bytes_changed, picture_changed), pictured),
        Kind("nav2", [folder / "probes" / "nav2.yaml", *sorted((folder / "campaigns" / "nav2").glob("*.yaml"))],
             (*text, words("nav2.yaml"), yaml_tree, yaml_tree), lambda file, rng: ["params", str(file)]),
        Kind("notebook", found("*.ipynb"), (*text, words("*.ipynb"), json_tree, json_tree),
             beside(family % f"{{map_file: {folder}/probes/map.yaml}}, " + "evaluation: {oracles: [MUTANT]}\n")),
        Kind("directory", [path for path in recorded if path.exists()], (bytes_changed, lines_changed, json_tree, json_tree),
             _directory_command),
    ]  # fmt: skip


def placed(kind: Kind, seed: Path, content: bytes, folder: Path) -> Path:
    """Write a mutant where its seed's neighbors are; of a campaign directory the whole is copied."""
    if kind.name != "directory":
        file = seed.with_name(f"mutant{seed.suffix}")
        file.write_bytes(content)
        return file
    copy = folder / "results" / "mutant"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.rmtree(copy.with_name("exported"), ignore_errors=True)
    shutil.copytree(seed.parent, copy)
    (copy / seed.name).write_bytes(content)
    return copy / seed.name


def is_named(said: str, file: Path) -> bool:
    """Whether a refusal names the file, or the campaign directory that it is a part of."""
    return file.name in said or (file.parent.name == "mutant" and str(file.parent) in said)
