"""Concurrent calls in one process that load the same plug-ins and scenarios."""

import json
from concurrent.futures import ThreadPoolExecutor

from room import SMALL_ROOM, drawn_room

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.scenario.language import declaring, grammar

NOISE = "laserscan_gaussian_noise_std_deviation"
SLOW = "import time; time.sleep(0.02)  # as a plug-in that imports large libraries\n"
CELL = "from helper import NUMBER\nverdicts = [{'run_index': i, 'judgment': 'pass'} for i in runs['run_index'].to_pylist()]"
CODE_CELL = {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": CELL}
FILES = {
    "noise.txt": "0.1 0.2",
    "helper.py": f"{SLOW}NUMBER = NUMBER_HERE\n",
    "own.py": f"""{SLOW}
from helper import NUMBER
from pathlib import Path
from vastflow.oracles.judgment import oracle
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer

class Own(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {{"{NOISE}": "system"}}
    files = ["noise.txt"]

    def produce(self, inputs, draws):
        for line in (Path(__file__).parent / "noise.txt").read_text().split():
            time.sleep(0.01)
            yield Fragment({{"{NOISE}": float(line) + NUMBER / 1e6}})

class Judge(oracle.Oracle[oracle.Parameters]):
    Parameters = oracle.Parameters

    def judge(self, trace, situation):
        return self.passed(trace)
""",
    "own.ipynb": json.dumps({"cells": [CODE_CELL], "metadata": {"number": "NUMBER_HERE"}, "nbformat": 4, "nbformat_minor": 5}),
    "own.osc": """
import osc.nav2
import osc.ros

scenario number_NUMBER_HERE:
    start_pose: pose_3d
    goal_pose: pose_3d
    robot: differential_drive_robot
    do serial:
        robot.init_nav2(start_pose)
        robot.nav_to_pose(goal_pose)
""",
}  # fmt: skip
OWN = """variations: [own.py:Own: {}]
execution: {scenario_file: own.osc, runs: 1}
evaluation: {oracles: [own.py:Judge, own.ipynb]}
"""
CAMPAIGN = SMALL_ROOM.partition("variations:")[0] + OWN


def read(file):
    """Read a campaign in this thread; number of its oracles, and the noise of its configurations."""
    campaign, oracles = read_campaign(file)
    return len(oracles), [each.scenario.system[NOISE] for each in instantiate(campaign).configurations]


def test_threads_load_shared_plug_ins_and_scenarios_without_failures(tmp_path, monkeypatch):
    """Two new files are read four times at once, so that nothing of them is loaded yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    grammar._parser.cache_clear()
    declaring._library.cache_clear()
    for number in range(3):
        place = tmp_path / f"round-{number}"
        drawn_room(place)
        for name, text in {**FILES, "first.vast": CAMPAIGN, "second.vast": CAMPAIGN}.items():
            (place / name).write_text(text.replace("NUMBER_HERE", str(number)))
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(read, [place / "first.vast", place / "second.vast"] * 2))
        assert found == [(3, [0.1 + number / 1e6, 0.2 + number / 1e6])] * 4
