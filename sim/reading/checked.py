"""The checked scenario: all inputs of its runs, read and checked.

A run takes nothing else, and keys of results take its digest. So the code that reads and checks is in no key: another
wording, another default or another comment changes a key exactly where it changes a value here.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import ProcessSetup, Scenario
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.costmaps import masks_of
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.system.robot import lidar_of, robot_of
from vastflow.sim.plug_ins.loading import code_value
from vastflow.sim.reading.abstract import content_digest, definition_digest, definition_of, plain_value
from vastflow.sim.reading.movers import MOVERS_KEY, movers_of
from vastflow.sim.reading.script import NAVIGATIONS, Script, calls_of, script_of
from vastflow.sim.reading.vocabulary import WORLDLY
from vastflow.sim.scenario.programs.config_files import configured
from vastflow.sim.system.keys import RECORDING_KEY
from vastflow.sim.system.robot import RobotParameters
from vastflow.sim.system.system import NO_MASKS, Masks
from vastflow.sim.world.difference import WorldDifference
from vastflow.sim.world.environment import MAP_KEY, WORLD_KEY, difference_of, world_file_of, world_files
from vastflow.sim.world.mover import MovingBody
from vastflow.sim.world.robot_model import Lidar, Robot

_CACHED: Final = "checked_digest"
_NOT_DESCRIBED: Final = RobotParameters()


@dataclass(frozen=True)
class RobotSetup:
    """A robot that drives, and where.

    Attributes:
        start: Pose of the robot at the start.
        parameters: Parameters of its navigation stack, all resolved.
        robot: Its body and actuators.
        lidar: Its laser scanner.
        difference: Difference of the world from the map; None without one.
        masks: Masks of the costmaps' filters.
        map_file: File of the map, or of the world for a robot without one.
        world_file: File that the world is read from; None where that is `map_file`.
        movers: Bodies that move.
    """

    map_file: FileContent
    start: Pose
    parameters: NavParameters
    robot: Robot
    lidar: Lidar
    difference: WorldDifference | None = None
    masks: Masks = NO_MASKS
    world_file: FileContent | None = None
    movers: tuple[MovingBody, ...] = ()


@dataclass(frozen=True)
class CheckedScenario:
    """The inputs of a scenario's runs, without the campaign's seed and the run's index.

    Attributes:
        timeout_s: Simulated time after which a run ends as timed out.
        situation: Digest that seeds runs, see `Scenario.situation_digest`.
        actions: Names of all actions that the script calls.
        is_sent: Whether the script sends the robot somewhere.
        robot: None where none drives.
        programs: Setup of a run's programs; None where the scenario starts none.
        handed: Files that are values of the script's parameters.
        recording: Recording of the only run; None where runs are simulated.
    """

    timeout_s: float
    situation: str
    script: Script
    actions: frozenset[str]
    is_sent: bool
    robot: RobotSetup | None
    programs: ProcessSetup | None
    handed: Mapping[str, FileContent]
    recording: FileContent | None = None


def checked_of(scenario: Scenario) -> CheckedScenario:
    """Read and check all of a scenario.

    Raises:
        ScenarioError: a robot without a place to start or without a map.
        ValueError: a scenario file, a parameter file or a value that can't be used, see `script_of` and `parameters_of`.
    """
    script = script_of(scenario)
    actions = frozenset(call.action for call in calls_of(script.definition.root))
    # A map alone makes no world: a scenario of programs may hand it on to them.
    needs_robot = actions & WORLDLY or (MAP_KEY in scenario.environment and script.start is not None)
    values = {**scenario.environment, **scenario.system, **scenario.task}
    given = {parameter.name: values.get(parameter.name) for parameter in script.definition.parameters}
    recording = scenario.system.get(RECORDING_KEY)
    return CheckedScenario(
        float(scenario.timeout_s),
        scenario.situation_digest,
        script,
        actions,
        any(action.rpartition(".")[2] in NAVIGATIONS for action in actions),
        _robot(scenario, script) if needs_robot else None,
        configured(scenario.programs, values),
        {key: value for key, value in given.items() if isinstance(value, FileContent)},
        recording if isinstance(recording, FileContent) else None,
    )


def checked_digest(scenario: Scenario) -> str:
    """Return the digest of all inputs of a scenario's runs.

    A scenario that can't be checked has that of what was written: its runs break, and nothing is stored under it.
    """
    known = scenario.__dict__  # kept beside its fields, as by a cached property, which would import what imports it
    if _CACHED not in known:
        known[_CACHED] = _checked_digest(scenario)
    found: str = known[_CACHED]
    return found


def _checked_digest(scenario: Scenario) -> str:
    try:
        checked = checked_of(scenario)
    except (ValueError, OSError):
        return digest("unchecked", scenario.digest)
    script, robot = checked.script, checked.robot
    is_files = script.definition is definition_of(scenario.abstract)
    return digest(
        checked.timeout_s,
        checked.situation,
        content_digest(scenario.abstract) if is_files else definition_digest(script.definition),
        plain_value(script.values),
        repr((script.start, script.goals, script.rounds, script.obstacles)),  # of numbers and names: five times as fast
        script.topics,
        [] if robot is None else _digested(robot),
        None if checked.programs is None else checked.programs.content,
        checked.handed,
        *([] if checked.recording is None else [checked.recording]),
    )


def _robot(scenario: Scenario, script: Script) -> RobotSetup:
    if script.start is None:
        raise ScenarioError("start_pose: expected a start_pose or init_nav2, got neither")
    parameters, files = parameters_of(scenario.system), world_files(scenario.environment)
    content = files.get(MAP_KEY, files.get(WORLD_KEY) if parameters.global_costmap.in_odom else None)
    if content is None:
        found = scenario.environment.get(MAP_KEY)
        raise ScenarioError(f"{MAP_KEY}: expected a map file that the campaign names, got {found!r}")
    masks = masks_of(scenario.system, parameters)
    robot, lidar = robot_of(parameters), lidar_of(parameters)
    if parameters.robot != _NOT_DESCRIBED:  # what is described is in the robot and the scanner
        parameters = parameters.model_copy(update={"robot": _NOT_DESCRIBED})
    world, movers = scenario.environment.get(WORLD_KEY) if MAP_KEY in files else None, movers_of(scenario.environment)
    if both := {body.name for body in movers} & {obstacle.name for obstacle in script.obstacles}:
        raise ScenarioError(f"{MOVERS_KEY}: expected names that no obstacle has, got {min(both)!r}")
    return RobotSetup(
        content,
        script.start,
        parameters,
        robot,
        lidar,
        difference_of(world),
        masks,
        world_file_of(world),
        movers,
    )


def _digested(robot: RobotSetup) -> Value:
    """Return the digested setup, with the code of other packages' plug-ins, which no source digest has."""
    parameters = robot.parameters
    return [
        *(robot.map_file, repr(robot.start), _parameters_digest(parameters)),
        *(code_value(type(each)) for each in (parameters.controller, parameters.planner, parameters.lidar_noise)),
        repr((robot.robot, robot.lidar)),
        *(() if robot.difference is None else (repr(robot.difference),)),
        *((repr(body), code_value(type(body.rule))) for body in robot.movers),
        *(() if robot.masks == NO_MASKS else (robot.masks.keepout, robot.masks.speed)),
    ]


@functools.lru_cache(maxsize=256)
def _parameters_digest(parameters: NavParameters) -> str:
    return digest(plain_value(parameters))
