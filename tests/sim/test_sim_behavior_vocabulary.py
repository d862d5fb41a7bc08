"""The names of actions, which are known without what implements them, are those of what does."""

import subprocess
import sys

from vastflow.sim.reading.vocabulary import ACTIONS, WORLDLY
from vastflow.sim.scenario.programs.actions import PROCESSES
from vastflow.sim.scenario.tree.entities import ENTITIES
from vastflow.sim.scenario.tree.helpers import HELPERS
from vastflow.sim.scenario.tree.navigation import NAVIGATION
from vastflow.sim.scenario.tree.stand_ins import stand_ins
from vastflow.sim.scenario.tree.topics import ROS


def test_worldly_actions_are_those_of_robot_and_entities():
    assert {*ENTITIES, *NAVIGATION, *ROS} - stand_ins({}).keys() == WORLDLY


def test_implemented_actions_are_the_known_ones():
    assert {*HELPERS, *ENTITIES, *NAVIGATION, *ROS, *PROCESSES, *stand_ins({})} == ACTIONS


def test_names_are_known_without_the_simulator():
    script = "import sys, vastflow.sim.reading.vocabulary; print(*{'numba', 'pymunk', 'scipy'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=240, check=True)
    assert done.stdout.split() == []
