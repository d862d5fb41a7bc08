"""Compare controllers and planner with recorded answers of Nav2's code for the same states.

The answers lie in a folder with `mppi.npz`, `navfn.npz`, `dwb.npz` and `rpp.npz`: that in the environment variable NAV2_CONFORMANCE, the
whole set in `../shared/reference/nav2-conformance` beside the repository, or else `tests/proofs/nav2_answers`, which `nav2_answers.py` drew
from it. Maps that NavFn's cases name are found from there upwards. Prints the folder and a table, the greatest distance of each kind
and what it may be.

Exit code 1 when one is greater than it may be; 2 when answers or a map are missing.

    python tests/proofs/nav2_conformance.py
"""

import json
import math
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from PIL import Image

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers import dwb, mppi, rpp
from vastflow.sim.nav2.controllers.controller import Controller, ControllerInput, Setting
from vastflow.sim.nav2.controllers.local_plan import local_plan
from vastflow.sim.nav2.controllers.mppi_samples import ROW, next_noise, words_of
from vastflow.sim.nav2.costmaps.inflation import inflate
from vastflow.sim.nav2.costmaps.outline import padded_outline
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.navigator.state import AHEAD_POINTS, MEMORY

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
import navfn_paths

VARIABLE = "NAV2_CONFORMANCE"
BESIDE = Path(__file__).parents[3] / "shared" / "reference" / "nav2-conformance"
DRAWN = Path(__file__).with_name("nav2_answers")
FILES = ("mppi.npz", "dwb.npz", "rpp.npz", "navfn.npz")
RESOLUTION_M = 0.05
OUTLINE = padded_outline(0.22, 0.01)
UNREACHED = 1e9
DT_S = 0.05


class Distance(NamedTuple):
    """The greatest distance of `cases` answers from Nav2's; it may be `most`."""

    part: str
    cases: int
    what: str
    found: float
    most: float
    unit: str = ""

    @property
    def row(self) -> str:
        """A row of the table."""
        found, most = (f"{value:.1e}" if 0.0 < value < 0.1 else f"{value:g}" for value in (self.found, self.most))
        return f"| {self.part} | {self.cases} | {self.what} | {found}{self.unit} | {most}{self.unit} |"


class MissingAnswersError(Exception):
    """Answers, or a map that they need, are not where they should be."""


def folder() -> Path:
    """Return the folder of recorded answers.

    Raises:
        MissingAnswersError: one of its files is missing.
    """
    given = os.environ.get(VARIABLE)
    place = Path(given) if given else BESIDE if BESIDE.is_dir() else DRAWN
    for file in FILES:
        if not (place / file).is_file():
            raise MissingAnswersError(
                f"{place / file}: expected recorded answers of Nav2's code, got no file. The checkout has a set in {DRAWN}; "
                f"{VARIABLE} names a folder with another one"
            )
    return place


# MPPI.


@njit
def _noise_place(stream: Any, at: Any, length: int, used: int) -> int:
    return next_noise(stream, at, length, used)


@njit
def _mppi(record: Any, memory: Any, window: Any, outline: Any, pose: Any, twist: Any, plan: Any, goal: Any) -> Any:
    given = ControllerInput(window, outline, 0.2255, pose, twist, plan[:, :2].copy(), plan[-1, 2], goal, DT_S, 0.0)
    return mppi.compute_velocity(record[0], memory, given)[:3]


def of_mppi(place: Path) -> Iterator[Distance]:
    """Cycles of MPPI with the noise that Nav2 had."""
    parameters = mppi.Mppi()
    speeds, turns, costs, samples, unlike = [], [], [], 0, 0
    critic = parameters.CostCritic
    points = (parameters.time_steps - 1) // critic.trajectory_point_step + 1
    collision = critic.collision_cost * critic.cost_weight / 254.0 / points
    for case in _numbered(place / "mppi.npz"):
        memory = mppi.new_memory(parameters, np.array([1], dtype=np.uint64))
        memory = _with_noise(memory, parameters, int(case["noise_seed"]))
        memory.sequence[:], memory.history[:] = case["sequence"], case["history"]
        window = Window(case["costs"].copy(), np.array([*case["origin"], float(case["resolution"])]))
        pose, twist, goal = (tuple(map(float, case[name])) for name in ("pose", "twist", "goal"))
        plan = np.ascontiguousarray(case["plan"])
        valid, v, w = _mppi(record_of(parameters), memory, window, OUTLINE, pose, twist, plan, goal)
        assert valid == bool(case["valid"])
        speeds.append(abs(v - case["command"][0]))
        turns.append(abs(w - case["command"][1]))
        found, theirs = np.asarray(memory.space.costs)[: parameters.batch_size], case["sample_costs"]
        free, ours_free = theirs < 0.5 * collision, found < 0.5 * collision
        samples += len(theirs)
        unlike += int(np.count_nonzero(free != ours_free))
        # What all samples share does not weigh: γ's term of the sequence itself.
        apart = (found - theirs)[free & ours_free]
        costs.append(float(np.abs(apart - np.median(apart)).mean()))
    yield Distance("MPPI", len(speeds), "speed", max(speeds), 3e-4, " m/s")
    yield Distance("MPPI", len(speeds), "yaw rate", max(turns), 4e-4, " rad/s")
    yield Distance("MPPI", len(speeds), "cost of a sample beside the others, mean of a cycle", max(costs), 2e-2)
    yield Distance("MPPI", samples, "share of the samples that collide in one of both only", unlike / samples, 1e-3)


def _with_noise(memory: Any, parameters: Any, seed: int) -> Any:
    """The memory with numbers of this seed where the next cycle will look for its noise."""
    samples, steps = parameters.batch_size, parameters.time_steps
    generator = np.random.default_rng(seed)
    groups = math.ceil(samples / ROW)
    noise = []
    for spread in (parameters.vx_std, parameters.wz_std):
        filled = np.zeros((groups * ROW, steps), dtype=np.float32)
        filled[:samples] = generator.standard_normal((samples, steps), dtype=np.float32) * np.float32(spread)
        noise.append(np.ascontiguousarray(filled.reshape(groups, ROW, steps).transpose(0, 2, 1)).ravel())
    words = words_of(*noise)
    at = _noise_place(memory.stream.copy(), memory.next_noise.copy(), len(memory.space.noise), len(words))
    all_words = memory.space.noise.copy()
    all_words[at : at + len(words)] = words
    all_words.flags.writeable = False
    return memory._replace(space=memory.space._replace(noise=all_words))


# DWB.


@njit
def _dwb(records: Any, memory: Any, window: Any, pose: Any, twist: Any, plan: Any, goal: Any) -> Any:
    given = ControllerInput(window, OUTLINE, 0.2255, pose, twist, plan, 0.0, goal, DT_S, 0.0)
    return dwb.compute_velocity(records[0], memory, given)[:3]


@njit
def _dwb_scores(records: Any, memory: Any, window: Any, pose: Any, twist: Any, plan: Any, goal: Any) -> Any:
    """Sums (V, W) of the critics, infinite where one of them forbids the trajectory."""
    q = records[0]
    given = ControllerInput(window, OUTLINE, 0.2255, pose, twist, plan, 0.0, goal, DT_S, 0.0)
    setting, ground, n_speeds, n_turns = dwb.score(q, memory, given)
    scores = memory.scores[:n_speeds, :n_turns].copy()
    for i in range(n_speeds):
        for j in range(n_turns):
            if not dwb.followed(q, setting, memory, ground, i, j)[0]:
                scores[i, j] = np.inf
    return scores


def of_dwb(place: Path) -> Iterator[Distance]:
    """Cycles of DWB: the plan it cuts, the critics' scores of every trajectory, the command on either plan."""
    answers = _answers(place / "dwb.npz")
    parameters = _dwb_parameters(answers)
    alone = {name: _with_one_critic(parameters, name) for name in map(str, answers["critics"])}
    cases, plans, unlike, samples = len(answers["nav2_ok"]), 0.0, 0, 0
    totals, scores = 0.0, 0.0
    commands = {"local_plan_odom": 0, "nav2_whole_plan_odom": 0}
    for case in range(cases):
        theirs = _part(answers, "nav2_whole_plan_odom", case)
        plans = max(plans, _apart_m(_cut(answers, case, parameters)[0], theirs))
        for name, answer in (("local_plan_odom", "nav2"), ("nav2_whole_plan_odom", "nav2_whole")):
            found = _dwb(record_of(parameters), *_dwb_state(answers, case, parameters, name))
            wanted = (bool(answers[f"{answer}_ok"][case]), *answers[f"{answer}_cmd"][case].tolist())
            commands[name] += found != wanted
        velocities = [tuple(each) for each in _part(answers, "traj_velocity", case, "traj_offset").tolist()]
        total = _part(answers, "traj_total", case, "traj_offset")
        ours = _dwb_totals(answers, case, parameters)
        samples += len(velocities)
        unlike += set(velocities) != set(ours)
        sums = np.array([ours.get(each, math.nan) for each in velocities])
        allowed = total >= 0.0
        unlike += int(np.count_nonzero(np.isfinite(sums) != allowed))
        totals = max(totals, np.abs(sums[allowed] - total[allowed]).max(initial=0.0))
        each_critic = _part(answers, "traj_critic_score", case, "traj_offset")
        for column, critic in enumerate(alone.values()):
            own = _dwb_totals(answers, case, critic)
            single = np.array([own.get(each, math.nan) for each in velocities])[allowed]
            scores = max(scores, np.abs(single - each_critic[allowed, column]).max(initial=0.0))
    yield Distance("DWB", cases, "local plan", plans, 1e-9, " m")
    yield Distance("DWB", samples, "trajectories allowed by one of both only", unlike, 0)
    yield Distance("DWB", samples, "score of a critic", scores, 0.0)
    yield Distance("DWB", samples, "sum of the critics", totals, 0.0)
    yield Distance("DWB", cases, "other commands, on the same plan", commands["local_plan_odom"], 0)
    yield Distance("DWB", cases, "other commands, from the global path", commands["nav2_whole_plan_odom"], 0)


def _dwb_parameters(answers: Mapping[str, Any]) -> dwb.Dwb:
    found = _parameters(dwb.Dwb, json.loads(str(answers["parameters_json"])))
    places = {str(name): place for place, name in enumerate(answers["critics"])}
    return found.with_values(**{name: getattr(found, name).with_values(place=place) for name, place in places.items()})


def _with_one_critic(parameters: dwb.Dwb, name: str) -> dwb.Dwb:
    groups = {other: group for other, group in parameters if hasattr(group, "place")}
    return parameters.with_values(
        **{other: group.with_values(enabled=other == name) for other, group in groups.items()}
    )


def _dwb_state(answers: Mapping[str, Any], case: int, parameters: dwb.Dwb, plan: str = "local_plan_odom") -> Any:
    window = _window(answers, case)
    memory = dwb.new_memory(parameters, *window.costs.shape)
    memory.trends.signs[:2] = answers["osc_before"][case]
    memory.trends.stood[:] = answers["osc_stationary_pose"][case]
    memory.trends.latched[:] = answers["rotate_latched_before"][case]
    pose, twist, goal = (tuple(answers[name][case].tolist()) for name in ("pose_odom", "twist", "goal_odom"))
    return memory, window, pose, twist, np.ascontiguousarray(_part(answers, plan, case)), goal


def _dwb_totals(answers: Mapping[str, Any], case: int, parameters: dwb.Dwb) -> dict[tuple[float, float], float]:
    """Sum of the critics by (v, ω)."""
    state = _dwb_state(answers, case, parameters)
    memory, scores = state[0], _dwb_scores(record_of(parameters), *state)
    rows, columns = scores.shape
    possible = (
        (i, j) for i in range(rows) for j in range(columns) if memory.speeds[i] != 0.0 or memory.turns[j] != 0.0
    )
    return {(float(memory.speeds[i]), float(memory.turns[j])): float(scores[i, j]) for i, j in possible}


# RPP.


@njit
def _rpp(
    records: Any, memory: Any, window: Any, outline: Any, inscribed_m: float, pose: Any, twist: Any, plan: Any,
    end_yaw_rad: float, goal: Any,
) -> Any:  # fmt: skip
    given = ControllerInput(window, outline, inscribed_m, pose, twist, plan, end_yaw_rad, goal, DT_S, 0.0)
    return rpp.compute_velocity(records[0], memory, given)


def of_rpp(place: Path) -> Iterator[Distance]:
    """Cycles of Regulated Pure Pursuit from the global path: its plan, its command, whether it sees a collision."""
    answers = _answers(place / "rpp.npz")
    parameters = _parameters(rpp.Rpp, json.loads(str(answers["parameters_json"])))
    cases, points, speeds, turns, unlike = len(answers["nav2_ok"]), 0, 0.0, 0.0, 0
    for case in range(cases):
        plan, end_yaw_rad = _cut(answers, case, parameters)
        points = max(points, abs(len(plan) - int(answers["nav2_plan_points"][case])))
        inscribed_m, _, tolerance_m = answers["inscribed_circumscribed_tolerance"][case].tolist()
        memory = rpp.RppMemory(np.zeros(1, dtype=np.int64), np.array([tolerance_m]))
        memory.reached[0] = answers["reached_before"][case]
        pose, twist, goal = (tuple(answers[name][case].tolist()) for name in ("pose_odom", "twist", "goal_odom"))
        outline = answers["footprint"][case].copy()
        window = _window(answers, case)
        valid, v, w = _rpp(
            record_of(parameters), memory, window, outline, inscribed_m, pose, twist, plan, end_yaw_rad, goal
        )
        unlike += valid != bool(answers["nav2_ok"][case])
        unlike += memory.reached[0] != answers["nav2_reached_after"][case]
        if valid and answers["nav2_ok"][case]:
            speeds = max(speeds, abs(v - answers["nav2_cmd"][case, 0]))
            turns = max(turns, abs(w - answers["nav2_cmd"][case, 1]))
    yield Distance("RPP", cases, "points of the local plan", points, 0)
    yield Distance("RPP", cases, "speed", speeds, 1e-6, " m/s")
    yield Distance("RPP", cases, "yaw rate", turns, 1e-5, " rad/s")
    yield Distance("RPP", cases, "collisions, or goals reached, in one of both only", unlike, 0)


# NavFn.


def of_navfn(place: Path) -> Iterator[Distance]:
    """Plans of NavFn: potentials, the cells they reach, and the paths down them, in cells."""
    medians, worst, reached, lengths, apart, empty = [], [], 0, 0.0, 0.0, 0
    for case in _numbered(place / "navfn.npz"):
        costs = _inflated(place, case)
        start, goal = (tuple(int(each) for each in case[name]) for name in ("start_cell_xy", "goal_cell_xy"))
        astar = bool(case["astar"])
        potential = navfn_paths.potential(costs, start, goal, use_astar=astar)
        rows, columns = case["cells_row_col"].T
        ours, theirs = potential[rows, columns].astype(float), case["potential"].astype(float)
        reached += abs(int(np.count_nonzero(potential < UNREACHED)) - int(case["reached_cells"]))
        reached += int(np.count_nonzero((ours < UNREACHED) != (theirs < UNREACHED)))
        both = (ours < UNREACHED) & (theirs < UNREACHED) & (theirs > 0.0)
        if both.any():
            relative = np.abs(ours - theirs)[both] / theirs[both]
            medians.append(float(np.median(relative)))
            worst.append(float(relative.max()))
        path, wanted = navfn_paths.path(costs, start, goal, use_astar=astar), case["path_cells_xy"].astype(float)
        empty += (len(path) == 0) != (len(wanted) == 0)
        if len(path) and len(wanted):
            lines = shapely.LineString(path), shapely.LineString(wanted)
            lengths = max(lengths, abs(lines[0].length - lines[1].length))
            apart = max(apart, shapely.hausdorff_distance(*lines))
    cases = len(medians)
    yield Distance("NavFn", cases, "potential, median", max(medians), 1e-6, " of it")
    yield Distance("NavFn", cases, "potential, worst", max(worst), 1e-3, " of it")
    yield Distance("NavFn", cases, "cells reached by one of both only", reached, 0)
    yield Distance("NavFn", cases, "length of the path", lengths, 0.5, " cells")
    yield Distance("NavFn", cases, "between the paths", apart, 0.5, " cells")
    yield Distance("NavFn", cases, "paths found by one of both only", empty, 0)


def _inflated(place: Path, case: Mapping[str, Any]) -> Any:
    """The costmap that a plan was made on."""
    radii = (float(case[name]) for name in ("inscribed_radius_m", "inflation_radius_m", "cost_scaling_factor"))
    return inflate(
        case["cells"].copy() if "cells" in case else map_cells(place, str(case["map"])), RESOLUTION_M, *radii
    )


def map_cells(place: Path, name: str) -> Any:
    """Return the costs of a map's cells before inflation, rows from below.

    Raises:
        MissingAnswersError: there is no such map above the folder.
    """
    file = next((up / name for up in (*place.resolve().parents, BESIDE.parents[1]) if (up / name).is_file()), None)
    if file is None:
        raise MissingAnswersError(
            f"{name}: expected a map in a folder above {place}, got no file. A case of NavFn's was recorded on it; the cases in "
            f"{DRAWN} carry their cells and need no map"
        )
    occupied = (255.0 - np.asarray(Image.open(file).convert("L"))[::-1].astype(float)) / 255.0
    return np.select([occupied >= 0.65, occupied <= 0.196], [254, 0], 255).astype(np.uint8)


# What they share.


@njit
def _local_plan(parameters: Any, memory: Any, window: Any, path: Any, out: Any) -> Any:
    return local_plan(parameters[0], memory[0], window, path, out)


def _cut(answers: Mapping[str, Any], case: int, controller: Controller) -> tuple[Any, float]:
    """The part of the global path that a controller gets, and the yaw of its end."""
    window, path = _window(answers, case), np.ascontiguousarray(_part(answers, "global_path_map", case))
    rows, columns = window.costs.shape
    setting = Setting(rows, columns, float(window.place[2]), 0.25, 0.25, np.zeros(1, dtype=np.uint64))
    cut = record_of(controller.plan_cut(setting))
    parameters = np.zeros(1, dtype=np.dtype([("plan_cut", cut.dtype)], align=True))
    parameters["plan_cut"] = cut
    memory = np.zeros(1, dtype=MEMORY)
    m = memory[0]
    m["map_odom_x"], m["map_odom_y"], m["map_odom_yaw"] = answers["map_to_odom"][case]
    c, s = math.cos(m["map_odom_yaw"]), math.sin(m["map_odom_yaw"])
    x, y, _ = answers["pose_odom"][case]
    m["x"], m["y"] = m["map_odom_x"] + c * x - s * y, m["map_odom_y"] + s * x + c * y
    m["path_n"] = m["path_end"] = len(path)
    poses = np.column_stack([path[:, :2], np.zeros(len(path))])
    poses[-1, 2] = answers["goal_yaw_map"][case]
    out = np.zeros((AHEAD_POINTS, 3))
    n, end_yaw_rad = _local_plan(parameters, memory, window, poses, out)
    return out[:n, :2].copy(), end_yaw_rad


def _apart_m(one: Any, other: Any) -> float:
    return float(np.abs(one - other).max(initial=0.0)) if len(one) == len(other) else math.inf


def _window(answers: Mapping[str, Any], case: int) -> Window:
    return Window(answers["costmap"][case].copy(), answers["costmap_origin_resolution"][case].copy())


def _part(answers: Mapping[str, Any], name: str, case: int, offsets: str = "") -> Any:
    """A case's rows of an array of all."""
    first, last = answers[offsets or f"{name.removesuffix('_odom').removesuffix('_map')}_offset"][case : case + 2]
    return answers[name][first:last]


def _parameters(kind: Any, values: Mapping[str, Any]) -> Any:
    """A group of parameters from numbers alone."""
    fields = {}
    for name, value in values.items():
        annotation = kind.model_fields[name].annotation
        if isinstance(value, Mapping):
            fields[name] = _parameters(annotation, value)
        else:
            fields[name] = bool(value) if annotation is bool else value
    return kind(**fields)


def _answers(file: Path) -> dict[str, Any]:
    with np.load(file) as answers:
        return {name: answers[name] for name in answers.files}


def _numbered(file: Path) -> Iterator[dict[str, Any]]:
    """The cases of a file whose keys are `NN/name`."""
    cases: dict[str, dict[str, Any]] = {}
    for key, value in _answers(file).items():
        number, _, name = key.partition("/")
        cases.setdefault(number, {})[name] = value
    yield from cases.values()


def main() -> int:
    """Print the folder and the table."""
    try:
        place = folder()
        found = [each for part in (of_mppi, of_dwb, of_rpp, of_navfn) for each in part(place)]
    except MissingAnswersError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"Answers of {place}:\n\n| part | cases | distance | greatest | at most |\n|---|---|---|---|---|")
    print("\n".join(each.row for each in found))
    return 0 if all(each.found <= each.most for each in found) else 1


if __name__ == "__main__":
    sys.exit(main())
