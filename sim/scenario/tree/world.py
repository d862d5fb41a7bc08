"""Actions on the simulated world, and how they are made for a run."""

import functools
from collections.abc import Callable, Mapping
from typing import TypeAlias

from vastflow.sim.loop.simulation import Simulation
from vastflow.sim.scenario.tree.action import Action, ActionFactory, ActionSituation

WorldAction: TypeAlias = Callable[[Simulation, ActionSituation], Action]
"""Makes an action of one run."""


def in_world(simulation: Simulation, actions: Mapping[str, WorldAction]) -> dict[str, ActionFactory]:
    """The actions as they are on a run's world."""
    return {name: functools.partial(action, simulation) for name, action in actions.items()}
