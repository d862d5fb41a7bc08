"""Read and execute files that others wrote, and describe each in a row."""

import math
import statistics
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import yaml
from PIL import Image

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.judgment.verdict import run_judgment
from vastflow.oracles.observation.observe import observe_block
from vastflow.producers.campaign_file.postprocessing import steps_of
from vastflow.producers.campaign_file.scenario import run_files
from vastflow.producers.floorplan.files import PlanFile, read_plan_file, read_variation_file
from vastflow.producers.floorplan.rendering import render
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.archive import write_outputs
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.faults import Fault, FileError, ScenarioError, message_of
from vastflow.sim.model.scenario import ProcessSetup, Scenario, scenario_of
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import read_nav2_document
from vastflow.sim.reading.abstract import abstract_content, definition_of
from vastflow.sim.reading.script import script_of
from vastflow.sim.reading.vocabulary import ACTIONS
from vastflow.sim.run import execute
from vastflow.sim.scenario.definition import Field
from vastflow.sim.scenario.tree.support import unsupported
from vastflow.sim.world.world import map_content

DRIVEN_M: Final = 1.0
"""A robot that was given a goal and covered less did not drive."""
RESOLUTION_M, LASER_M = 0.05, 0.193
PLANS_OF_A_VARIATION: Final = 2
SCENARIO_TIMEOUT_S: Final = 120.0

Kind = Literal["campaign", "scenario", "floor plan", "variation", "Nav2 parameters"]
Outcome = Literal["refused", "valid", "ran"]


@dataclass(frozen=True)
class Row:
    """One file.

    Attributes:
        outcome: `valid` where reading it is all that there is to do.
        sent: Runs in which the robot was given a goal; `drove` of them covered `DRIVEN_M`.
        distance_m: That the robot covered in these, in the middle.
        broken: Runs, families and steps that could not be done.
        reason: Why it was refused, what broke first, or what was made of it.
    """

    file: str
    kind: Kind
    outcome: Outcome
    reason: str = ""
    configurations: int = 0
    rejected: int = 0
    runs: int = 0
    sent: int = 0
    drove: int = 0
    distance_m: float | None = None
    passed: int = 0
    failed: int = 0
    not_judged: int = 0
    broken: int = 0


class Ran(NamedTuple):
    """One run: its distance if the robot was given a goal, its judgment, empty where the run broke, and why."""

    distance_m: float | None
    judgment: str
    reason: str = ""


class Trial(NamedTuple):
    """The tried part of a campaign: runs of a configuration, configurations at most or None for all, and processes."""

    runs: int = 1
    sample: int | None = None
    workers: int = 1


def _told(runs: Sequence[Ran]) -> tuple[str, dict[str, Any]]:
    """Why the first run that broke did, or else the first that failed; and counts of a `Row`."""
    distances = [run.distance_m for run in runs if run.distance_m is not None]
    judgments = Counter(run.judgment for run in runs)
    reasons = (run.reason for judgment in ("", "fail", "not judged") for run in runs if run.judgment == judgment)
    return next(reasons, ""), {
        "runs": len(runs),
        "sent": len(distances),
        "drove": sum(distance >= DRIVEN_M for distance in distances),
        "distance_m": round(statistics.median(distances), 2) if distances else None,
        **{name: judgments[said] for name, said in (("passed", "pass"), ("failed", "fail"), ("broken", ""))},
        "not_judged": judgments["not judged"],
    }


def rows_of(folder: Path, trial: Trial) -> Iterator[Row]:
    """A row for each file below a folder that vastflow reads, by name."""
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        kind = "Nav2 parameters" if _is_nav2(file) else KINDS.get(file.suffix)
        if kind is None:
            continue
        name = file.relative_to(folder).as_posix()
        try:
            outcome, reason, counts = _MAKERS[kind](file, trial)
            yield Row(name, kind, outcome, reason, **counts)
        except (FileError, ScenarioError, UnicodeDecodeError) as error:
            faults = [_short(fault, file) for fault in error.faults] if isinstance(error, FileError) else [_line(error)]
            yield Row(name, kind, "refused", _first(faults))
        except Exception as error:  # noqa: BLE001 - what should never be raised is told, with all the other files
            yield Row(name, kind, "refused", f"{type(error).__name__}: {_line(error)}", broken=1)


KINDS: Final[Mapping[str, Kind]] = {
    ".vast": "campaign",
    ".osc": "scenario",
    ".fpm": "floor plan",
    ".fpm2": "floor plan",
    ".variation": "variation",
}


def _is_nav2(file: Path) -> bool:
    if file.suffix not in (".yaml", ".yml"):
        return False
    try:
        found = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return False
    nodes = {"amcl", "controller_server", "planner_server", "local_costmap", "global_costmap", "bt_navigator"}
    return isinstance(found, Mapping) and not nodes.isdisjoint(found)


Made = tuple[Outcome, str, dict[str, Any]]
"""Outcome, reason, and counts of a row."""


def _campaign(file: Path, trial: Trial) -> Made:
    campaign, oracles = read_campaign(file)
    if campaign.unexecutable:
        return "valid", campaign.unexecutable[0].problem, {}
    if campaign.search is not None:
        return "valid", "a search: what it runs follows from its runs", {}
    made = instantiate(campaign)
    distinct = [each for each in made.configurations if each.duplicate_of is None]
    step = 1 if trial.sample is None else math.ceil(len(distinct) / trial.sample) or 1  # at equal distances
    wanted = [(each.scenario, run) for each in distinct[::step] for run in range(trial.runs)]
    with ProcessPoolExecutor(trial.workers) as pool:
        runs = list(pool.map(partial(_run, oracles=oracles, seed=campaign.seed), *zip(*wanted, strict=True)))
    reason, counts = _told(runs)
    steps = steps_of(campaign.spec.results_processing.postprocessing)
    undone = [message_of(*complaint) for step in steps if (complaint := step.complaint(file.parent))]
    missing = [_short(faults[0], file) for faults in campaign.unavailable.values()]
    counts["broken"] += len(undone) + len(missing)
    reasons = [reason, *undone, *missing, *(each.reason for each in made.rejections[:1])]
    counts |= {"configurations": len(distinct), "rejected": len(made.rejections)}
    return "ran" if counts["runs"] else "refused", _first(filter(None, reasons)), counts


def _scenario(file: Path, trial: Trial) -> Made:
    content = abstract_content(file)
    definition = definition_of(content)
    if lacking := unsupported(definition, ACTIONS):
        return "refused", _first([message_of(each.problem, each.expected) for each in lacking]), {}
    with tempfile.TemporaryDirectory() as folder:
        values: dict[str, Any] = {"map_file": map_content(_room(Path(folder)))}
        for parameter in definition.parameters:
            if parameter.default is None and parameter.name not in values:
                values[parameter.name] = _made_up(parameter)
        setup = ProcessSetup(run_files(file.parent, ["files/**"]))
        scenario = scenario_of(values, {}, abstract=content, timeout_s=SCENARIO_TIMEOUT_S, programs=setup)
        return "ran", *_told([_run(scenario, 0, oracles=oracles_of([], file.parent), seed=0)])


def _floor_plan(file: Path, trial: Trial) -> Made:
    plan = read_plan_file(file)
    written = render(plan.building(), plan.text, str(file), RESOLUTION_M, LASER_M)
    picture = next(content for name, content in written.items() if name.endswith(".pgm"))
    width, height = picture.split(maxsplit=3)[1:3]
    return "ran", f"map of {int(width)} x {int(height)} cells", {}


def _variation(file: Path, trial: Trial) -> Made:
    variation = read_variation_file(file).variation()
    for seed in range(PLANS_OF_A_VARIATION):
        plan = PlanFile(f"{seed}.fpm", variation.sample(seed).text)
        render(plan.building(), plan.text, plan.name, RESOLUTION_M, LASER_M)
    return "ran", f"{PLANS_OF_A_VARIATION} plans drawn", {}


def _nav2(file: Path, trial: Trial) -> Made:
    found = findings(interpretation(read_nav2_document(file)))
    unmodeled = sum(each.status == "not modeled" for each in found)
    return "valid", f"{len(found)} parameters, {unmodeled} of them not modeled", {}


_MAKERS: Final[Mapping[Kind, Callable[[Path, Trial], Made]]] = {
    "campaign": _campaign,
    "scenario": _scenario,
    "floor plan": _floor_plan,
    "variation": _variation,
    "Nav2 parameters": _nav2,
}


def _run(scenario: Scenario, run_index: int, *, oracles: Sequence[Oracle[Any]], seed: int) -> Ran:
    """Execute, observe and judge one run."""
    try:
        sent = bool(script_of(scenario).goals)
        recording = execute(scenario, run_index, seed).recording
        block = write_recordings([recording])
        outputs = write_outputs({run_index: recording.outputs})
        verdicts = judge_block(scenario, block, observe_block(scenario, block), oracles, outputs).verdicts
    except Exception as error:  # noqa: BLE001 - a run that breaks is what the table tells
        return Ran(None, "", f"{type(error).__name__}: {_line(error)}")
    judgment = run_judgment(verdict.judgment for verdict in verdicts)
    reasons = [verdict.reason for verdict in verdicts if verdict.judgment == judgment and verdict.reason]
    return Ran(recording.run.distance_m if sent else None, judgment, _first(reasons))


ROOM_M: Final = (12.0, 8.0)
PLACES: Final = [(-1.0, 0.0), (1.5, 1.0), (3.0, -1.0), (0.0, -2.0), (-3.0, 2.0), (0.0, 2.0)]
"""Goals in the room, from which any two that follow each other are more than a meter apart."""


def _room(folder: Path) -> Path:
    """A map of an empty room round the origin."""
    cells = np.pad(np.full([round(length_m / RESOLUTION_M) - 4 for length_m in ROOM_M[::-1]], 254, dtype=np.uint8), 2)
    Image.fromarray(cells).save(folder / "room.pgm")
    origin = [-ROOM_M[0] / 2, -ROOM_M[1] / 2, 0.0]
    (folder / "room.yaml").write_text(f"{{image: room.pgm, resolution: {RESOLUTION_M}, origin: {origin}}}\n")
    return folder / "room.yaml"


def _made_up(parameter: Field) -> Any:
    """A value of a parameter's type."""
    kind = parameter.type
    if kind.name == "pose_3d":
        if kind.is_list:
            return [_pose(*place) for place in PLACES[:2]]
        number = "".join(letter for letter in parameter.name if letter.isdigit())
        return _pose(-4.0, 0.0) if "start" in parameter.name else _pose(*PLACES[int(number or 0) % len(PLACES)])
    if kind.is_list:
        return []
    by_name: dict[str, Any] = {"string": "1", "bool": True, "float": 1.0, "position_3d": {"x": 1.0, "y": 0.0}}
    return by_name.get(kind.name, {} if kind.kind == "struct" else 1)


def _pose(x_m: float, y_m: float) -> dict[str, Any]:
    return {"position": {"x": x_m, "y": y_m}, "orientation": {"yaw": 0.0}}


def _short(fault: Fault, file: Path) -> str:
    place = "" if Path(fault.place.file) == file else f"{Path(fault.place.file).name}:"
    said = f"{place}{fault.place.line}: {fault.place.where}: {message_of(fault.problem, fault.expected)}"
    return said.replace(f"{file.parent}/", "")


def _first(reasons: Iterable[str]) -> str:
    listed = list(reasons)
    more = f" (and {len(listed) - 1} more)" if len(listed) > 1 else ""
    return f"{listed[0]}{more}" if listed else ""


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:300]
