"""Planners as plug-ins: found by Nav2's name or in a file, checked by the conformance suite, driven with."""

import re
from pathlib import Path

import numpy as np
import pytest
from driving import drive
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameter_files.plug_ins import PLANNER_PLUG_INS, find_planner
from vastflow.sim.nav2.planners.conformance import CHECKS, check_inputs_are_kept, check_paths, check_planner
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

PAGE = Path(__file__).parents[2] / "docs" / "write-a-planner.md"


@pytest.fixture
def folder(tmp_path):
    """The files of the page."""
    for name in ("my_wavefront.py", "my_wavefront.yaml"):
        (text,) = re.findall(rf"^```\w+ {re.escape(name)}\n((?:.*\n)*?)^```$", PAGE.read_text(), re.MULTILINE)
        (tmp_path / name).write_text(text)
    return tmp_path


def system(folder):
    return {"nav2_params": nav2_file(folder / "my_wavefront.yaml"), "controller": "rpp"}


@each_row("check", CHECKS)
def test_page_planner_keeps_contract(folder, check):
    check(find_planner("my_wavefront.py:Wavefront", folder)())


@each_row("name", PLANNER_PLUG_INS.known)
def test_shipped_planners_keep_contract(name):
    check_planner(find_planner(name)())


def test_robot_drives_by_page_planner(folder, two_rooms_map):
    parameters = parameters_of(system(folder))
    assert (type(parameters.planner).__name__, parameters.planner.most_cost) == ("Wavefront", 200)
    assert with_kernels(parameters.planner) is parameters.planner
    prepared = prepare(World(two_rooms_map), Lidar(), parameters)
    start, mission = Pose(2.0, 2.4, 0.0), Mission("navigate_to_pose", (Pose(6.0, 2.4, 0.0),))
    one, other = (drive(prepared, parameters, Lidar(), Robot(), start, mission, (), (1, 2, 3), 60.0) for _ in range(2))
    assert one.run.outcome == "succeeded"
    assert all(np.array_equal(one.columns[name], other.columns[name]) for name in one.columns)


@each_row(
    ("edit", "message"),
    [
        ("most_cost|most_cots", "Did you mean 'most_cost'?"),
        ("Wavefront|Wavefrunt", "Did you mean 'Wavefront'?"),
        ("my_wavefront.py:Wavefront|nav2_navfn_planner::NavFnPlanner", "mean 'nav2_navfn_planner::NavfnPlanner'?"),
    ],
)
def test_parameter_file_with_wrong_planner_is_refused(folder, edit, message):
    edited = folder / "edited.yaml"
    edited.write_text((folder / "my_wavefront.yaml").read_text().replace(*edit.split("|")))
    with pytest.raises(FileError, match=re.escape(message)):
        nav2_file(edited)


def test_planner_fails_check_when_it_changes_prepared_data(folder):
    file = folder / "my_wavefront.py"
    queue = "np.zeros(setting.costs.size, dtype=np.int64)"
    text = file.read_text().replace(queue, "*setting.prepared")
    file.write_text(f"{text}\n    def prepare(self, setting):\n        return ({queue},)\n")
    with pytest.raises(AssertionError, match=r"Wavefront must not change what it is given"):
        check_inputs_are_kept(find_planner("my_wavefront.py:Wavefront", folder)())


def test_planner_through_walls_fails_its_check(folder):
    file = folder / "my_wavefront.py"
    file.write_text(file.read_text().replace("<= q.most_cost", "<= 255"))
    with pytest.raises(AssertionError, match=r"my_wavefront.py:\d+: Wavefront must keep to free cells"):
        check_paths(find_planner("my_wavefront.py:Wavefront", folder)())
