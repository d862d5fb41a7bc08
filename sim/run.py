"""Execution of a run: one scenario, one seed → one recording."""

import functools
import math
import os
import resource
import time
import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, get_type_hints

import numpy as np

from vastflow.sim.kernels.streams import run_entropy
from vastflow.sim.loop.drive import Ending, Watch, Watched, recording_of, recording_without_world, seed_text
from vastflow.sim.loop.simulation import Simulation, recorded
from vastflow.sim.model.archive import table
from vastflow.sim.model.blocks import read_recordings
from vastflow.sim.model.digest import FileContent, file_digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.files import read_bytes
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Recording, RunLog
from vastflow.sim.model.scenario import ProcessSetup, Scenario
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.plug_ins.loading import check_permitted
from vastflow.sim.reading.checked import CheckedScenario, RobotSetup, checked_of
from vastflow.sim.scenario.programs.actions import PROCESSES, process_actions
from vastflow.sim.scenario.programs.folders import CONFIG, OUT
from vastflow.sim.scenario.programs.run import ProcessRun, process_run
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.stand_ins import stand_ins
from vastflow.sim.scenario.tree.topics import ROS
from vastflow.sim.scenario.tree.tree import ScenarioTree, StatusChange
from vastflow.sim.scenario.tree.world import WORLD
from vastflow.sim.world.mover import drawn_movers
from vastflow.sim.world.world import read_grid, read_world

PERIOD_S: Final = 0.1
"""Period of a scenario's tree."""
TICKS: Final = round(PERIOD_S / TICK_S)
"""Ticks of the closed loop in a period of the tree."""


def play(
    tree: ScenarioTree,
    timeout_s: float,
    simulation: Simulation | None,
    programs: ProcessRun | None,
    watch: Watch | None = None,
    watch_ticks: Sequence[int] = (),
) -> None:
    """Run a scenario to its end, or to the end of its time.

    The tree is ticked ten times a simulated second; ticks that can change nothing are skipped. While a program runs, no tick
    is skipped, and each lasts 0.1 s of host time or until the program ends, unless the simulation keeps a pace of its own.

    Args:
        simulation: The robot in its world; None for a scenario without.
        programs: Environment of the scenario's programs, if it starts any.
        watch, watch_ticks: See `run`.
    """
    world = Watched(simulation, watch, watch_ticks) if simulation else None
    last = math.floor(timeout_s / PERIOD_S + 1e-9)
    number = 0
    began_s = time.monotonic()
    while not tree.ended and number < last:
        waiting = programs is not None and programs.waiting
        number = int(number + 1 if waiting else min(tree.next_tick(), last))
        if world and simulation:
            world.advance(number * TICKS)
            number = -(-simulation.tick // TICKS)  # the first tick after the mission's end
            world.advance(number * TICKS)
        if programs is not None and waiting:
            is_paced = simulation is not None and simulation.is_paced
            programs.wait(0.0 if is_paced else max(0.0, began_s + PERIOD_S - time.monotonic()))
        began_s = time.monotonic()
        tree.tick(number)


_SCENARIO_STREAM: Final = 0x5CE
"""Separates a scenario's random numbers from those of the robot's subsystems."""


@dataclass(frozen=True)
class Execution:
    """A run that was executed: its recording and its log."""

    recording: Recording
    log: RunLog


def run(
    scenario: Scenario,
    run_index: int,
    seed: int = 0,
    watch: Watch | None = None,
    watch_ticks: Sequence[int] = (),
) -> Recording:
    """Execute one run.

    Equal (scenario, run index, seed, code) give equal recordings, except for the output of programs.

    Args:
        seed: The campaign's `execution.seed`.
        watch: Called with the stack and a tick after that tick; it must not change the stack.
        watch_ticks: These ticks, in increasing order; those after the run's end are left out.

    Raises:
        ScenarioError: the scenario can't work, such as a map that changed since the scenario was made, a `pre_command` that
            failed, an expression without a value, or a robot that was never given a goal.
        ValueError: a scenario file or a value that can't be used, see `vastflow.sim.reading.script.script_of`.
    """
    return execute(scenario, run_index, seed, watch, watch_ticks).recording


def execute(
    scenario: Scenario,
    run_index: int,
    seed: int = 0,
    watch: Watch | None = None,
    watch_ticks: Sequence[int] = (),
) -> Execution:
    """Execute one run as `run` does, and return its log as well."""
    started_s, wall_s, cpu_s = time.time(), time.perf_counter(), time.process_time()
    checked = checked_of(scenario)
    entropy = run_entropy(seed, checked.situation, run_index)
    if checked.recording is not None:
        if watch is not None:
            raise ScenarioError("expected a simulated run, got a recorded one, which can't be executed once more")
        recording = _recorded_elsewhere(checked.recording, entropy)
        return Execution(recording, RunLog(started_s, time.perf_counter() - wall_s, time.process_time() - cpu_s, 0))
    lines: list[str] = []
    setup = checked.programs or ProcessSetup()
    nodes = setup.nodes
    if watch is not None and nodes is not None:
        raise ScenarioError(
            "expected a run of the built-in stack, got one that nodes drove, which can't be executed once more"
        )
    with ExitStack() as stack:
        if needs_programs := checked.actions & PROCESSES.keys() or checked.programs:
            check_permitted("programs of the scenario", scenario.digest)
        programs: ProcessRun | None = None
        simulation: Simulation | None = None
        if nodes is not None and checked.robot:
            from vastflow.sim.nodes.driving import driven_run  # seldom needed

            arguments = functools.partial(_arguments, checked, entropy=entropy)
            start = driven_run(setup, checked.handed, nodes, checked.robot, arguments)
            programs, simulation = stack.enter_context(start)
        elif checked.robot:
            simulation = Simulation(*_arguments(checked, checked.robot, entropy))
        if needs_programs and programs is None:
            programs = stack.enter_context(process_run(setup, checked.handed))
        tree = _tree(checked, simulation, programs, entropy, lines)
        try:
            play(tree, checked.timeout_s, simulation, programs, watch, watch_ticks)
        finally:
            tree.shutdown()
        told, health = simulation.finish() if simulation else ((), {})
        lines += told
        record = programs.close() if programs else None
    ending, behaviors = _ending(tree), table(get_type_hints(StatusChange), tree.changes)
    if simulation:
        if simulation.sent_s is None and checked.is_sent:
            raise ScenarioError(f"the robot was never given a goal: {ending.reason or 'the scenario ended before'}")
        recording = recording_of(simulation, entropy, ending, behaviors)
        if (topics := checked.script.topics) is not None:
            recording = replace(recording, columns=recorded(recording.columns, topics))
    else:
        recording = recording_without_world(tree.now_s, entropy, ending, behaviors)
    if record:
        recording = replace(recording, outputs=record.outputs)
    ran_s = time.perf_counter() - wall_s
    if record:
        used, outputs = (record.usage.cpu_s, record.usage.max_rss_bytes), record.outputs
        left_out = (f"{left.path} ({left.size_bytes} bytes) is not kept: {left.why}" for left in outputs.left_out)
        notes = (*outputs.notes, *left_out, *filter(None, [record.post_command, record.note]))
        log = RunLog(started_s, ran_s, *used, tuple(lines), record.logs, record.resources, notes, health)
    else:
        peak_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        log = RunLog(started_s, ran_s, time.process_time() - cpu_s, peak_bytes, tuple(lines))
    return Execution(recording, log)


def _recorded_elsewhere(file: FileContent, entropy: Sequence[int]) -> Recording:
    """Return the run in a file by `write_recordings`, with the seed of its scenario."""
    content = read_bytes(Path(file.path))
    if file_digest(file.path) != file.digest:
        raise ScenarioError(f"{file.path}: expected the recording that the campaign was read with, got another")
    if entropy[-1]:
        raise ScenarioError(f"expected run 0, the only one that {Path(file.path).name} has, got run {entropy[-1]}")
    (recording,) = read_recordings(content)
    run = replace(recording.run, run_index=0, seed=seed_text(entropy))
    return replace(recording, run=run, behaviors=table(get_type_hints(StatusChange), []))


def _arguments(checked: CheckedScenario, robot: RobotSetup, entropy: Sequence[int]) -> tuple[Any, ...]:
    """Return the arguments of a simulation."""
    masks = [None if mask is None else read_grid(mask) for mask in robot.masks]
    world = read_world(robot.map_file, robot.difference, robot.world_file)
    prepared = prepare(world, robot.lidar, robot.parameters, *masks)
    obstacles, timeout_s = checked.script.obstacles, checked.timeout_s
    given = prepared, robot.parameters, robot.lidar, robot.robot, robot.start, obstacles, entropy, timeout_s
    return *given, drawn_movers(robot.movers, entropy)


def _tree(
    checked: CheckedScenario,
    simulation: Simulation | None,
    programs: ProcessRun | None,
    entropy: Sequence[int],
    lines: list[str],
) -> ScenarioTree:
    own = {**HELPERS, **(process_actions(programs) if programs else {})}
    actions = {**own, **stand_ins(own)}
    if simulation:
        worldly = {**WORLD, **ROS}
        actions |= {name: functools.partial(action, simulation) for name, action in worldly.items()}
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([*entropy, _SCENARIO_STREAM])))
    below_config = checked.programs.scenario_folder if checked.programs else ""
    functions = helper_functions(rng, os.path.join(CONFIG, below_config).rstrip("/"), OUT)
    made: list[weakref.ref[ScenarioTree]] = []  # weak: the tree holds its log

    def log(line: str) -> None:
        tree = made[0]()
        lines.append(f"{tree.now_s if tree else 0.0:.1f} s: {line}")

    tree = ScenarioTree(checked.script.definition, checked.script.values, actions, functions, log=log)
    made.append(weakref.ref(tree))
    return tree


def _ending(tree: ScenarioTree) -> Ending:
    if tree.passed:
        return Ending("succeeded")
    if not tree.ended:
        waited = f", waiting for {', '.join(tree.awaited)}" if tree.awaited else ""
        return Ending("timed_out", f"the scenario did not end within its time{waited}")
    if tree.reason.cause == "timeout":
        return Ending("timed_out", tree.reason.message)
    return Ending("aborted" if tree.reason.error_code else "failed", tree.reason.message, tree.reason.error_code)
