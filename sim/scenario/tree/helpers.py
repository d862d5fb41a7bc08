"""Actions and functions of `osc.helpers` that need neither simulator nor process."""

import os.path
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from vastflow.sim.model.faults import ScenarioError, message_of
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.evaluation import OPERATORS
from vastflow.sim.scenario.tree.action import ActionFactory, ActionSituation, Immediate
from vastflow.sim.scenario.tree.messages import member_of, pose_3d_in

COMPARISONS: Final = ("==", "!=", "<", "<=", ">", ">=")
"""Operators of `compare`."""

SHARE: Final = "/opt/ros/share"
"""Folder of ROS packages, which does not exist; a scenario may pass it to a launch."""


class Helper(Immediate):
    """An immediate action that needs neither simulator nor process."""

    def __init__(self, situation: ActionSituation) -> None:
        self.situation = situation


class Log(Helper):
    """`log(msg)`: a line in the run's log."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        self.message = str(arguments["msg"])
        self.situation.log(self.message)
        return True


class Compare(Helper):
    """`compare(left_value, operator, right_value)`: fails where the relation does not hold; one without meaning is a `ScenarioError`."""

    def act(self, arguments: Mapping[str, Any]) -> bool:
        left, sign, right = arguments["left_value"], str(arguments["operator"]), arguments["right_value"]
        if sign not in COMPARISONS:
            raise ScenarioError(f"compare: expected one of {', '.join(COMPARISONS)}, got {sign!r}")
        try:
            holds = bool(OPERATORS[sign](left, right))
        except TypeError:
            raise ScenarioError(f"{left!r} and {right!r} can't be compared by {sign}") from None
        self.message = f"{left!r} {sign} {right!r} {'holds' if holds else 'does not hold'}"
        return holds


class Increment(Helper):
    """`increment(target_variable)`: one more in a variable that holds a number; the argument is the variable's name."""

    step = 1

    def act(self, arguments: Mapping[str, Any]) -> bool:
        name, variables = arguments["target_variable"], self.situation.variables
        if not isinstance(name, str) or name not in variables:
            right = did_you_mean(str(name), variables)
            raise ScenarioError(message_of(f"{name!r} is not a variable with a value", right))
        value = variables[name]
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ScenarioError(f"{name}: expected a number to count, got {value!r}")
        variables[name] = value + self.step
        self.message = f"{name} is {variables[name]}"
        return True


class Decrement(Increment):
    """`decrement(target_variable)`: one less in a variable that holds a number."""

    step = -1


HELPERS: Final[Mapping[str, ActionFactory]] = {
    "log": Log,
    "compare": Compare,
    "increment": Increment,
    "decrement": Decrement,
}
"""Actions by their names in a file."""


class RandomNumbers:
    """`random`: numbers of a run, drawn from its own generator in the order of evaluation."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def seed(self, number: int) -> int:
        """Seed the generator, equally in all runs, and return the seed."""
        self._rng = np.random.Generator(np.random.PCG64(abs(number)))
        return number

    def get_float(self, least: float, most: float) -> float:
        """Return a uniform number between two; ValueError if the first is greater."""
        return least + (most - least) * float(self._rng.random()) if _ordered(least, most) else least

    def get_int(self, least: int, most: int) -> int:
        """Return a whole number between two, both included; ValueError if the first is greater."""
        return int(self._rng.integers(least, most, endpoint=True)) if _ordered(least, most) else least

    def get_random_string(self, choices: list[str]) -> str:
        """Return one item of a list; ValueError for an empty one."""
        if not choices:
            raise ValueError("a list to draw from has at least one item")
        return choices[int(self._rng.integers(len(choices)))]


def _ordered(least: float, most: float) -> bool:
    if least > most:
        raise ValueError(f"the lower bound comes first, got {least!r} and {most!r}")
    return least < most


def helper_functions(
    rng: np.random.Generator, scenario_folder: str, output_folder: str
) -> dict[str, Callable[..., Any]]:
    """Return the functions of `osc.helpers`, `osc.os`, and `osc.ros` for one run.

    Args:
        rng: The run's own, for `random`.
        scenario_folder: Folder of the scenario file, as programs know it; `os.abspath` is relative to it.
        output_folder: Folder that the run writes to, as programs know it.
    """
    numbers = RandomNumbers(rng)
    drawn = (numbers.seed, numbers.get_float, numbers.get_int, numbers.get_random_string)
    return {
        **{f"random.{function.__name__}": function for function in drawn},
        "common.get_scenario_file_directory": lambda: scenario_folder,
        "common.get_output_directory": lambda: output_folder,
        "msg_conversion.get_object_member": member_of,
        "msg_conversion.to_pose_3d": pose_3d_in,
        "ament.get_package_share_directory": lambda package: f"{SHARE}/{package}",
        "os.abspath": lambda path: os.path.normpath(os.path.join(scenario_folder, path)),
        "os.basename": os.path.basename,
        "os.dirname": os.path.dirname,
    }
