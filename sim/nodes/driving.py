"""Runs that nodes of ROS 2 drive: their domain, their processes, and the simulation between them."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.nodes import Nodes
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.nav2.parameter_files.command_chain import NO_SMOOTHER
from vastflow.sim.nav2.parameters.servers import CollisionMonitor
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nodes.domain import own_domain
from vastflow.sim.nodes.driven import DrivenSimulation
from vastflow.sim.nodes.starting import started
from vastflow.sim.reading.checked import RobotSetup
from vastflow.sim.scenario.programs.run import ProcessRun, process_run
from vastflow.sim.world.world import read_world

WATCHDOG_S: Final = 0.5
"""Time without a command after which the base stops, as that of a Create 3 does."""


@contextmanager
def driven_run(
    setup: ProcessSetup,
    handed: Mapping[str, FileContent],
    nodes: Nodes,
    robot: RobotSetup,
    arguments_of: Callable[[RobotSetup], tuple[Any, ...]],
) -> Iterator[tuple[ProcessRun, DrivenSimulation]]:
    """Start a run's nodes, and yield its processes and its simulation; all end with the `with`.

    Args:
        arguments_of: Returns the arguments of a simulation of a robot.

    Raises:
        ScenarioError: no domain is free, or a process is not ready. The run is not to be judged.
    """
    ground = read_world(robot.map_file, robot.difference, robot.world_file).ground
    with (
        own_domain() as (domain, held),
        process_run(setup, handed, holds=[held]) as programs,
        started(programs, nodes, domain, robot.lidar, ground) as ready,
    ):
        bare = replace(robot, parameters=_without_command_path(robot.parameters))
        yield programs, DrivenSimulation(*arguments_of(bare), started=ready, lidar=robot.lidar)


def _without_command_path(parameters: NavParameters) -> NavParameters:
    """Return the parameters of a robot without velocity smoother and collision monitor: nodes bring their own."""
    update = {
        "velocity_smoother": NO_SMOOTHER.model_copy(update={"velocity_timeout": WATCHDOG_S}),
        "collision_monitor": CollisionMonitor(enabled=False),
    }
    return parameters.model_copy(update=update)
