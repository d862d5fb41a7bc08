"""The map of an empty room, and plug-ins for campaigns in it."""

import numpy as np
from PIL import Image


def drawn_room(folder, cells=120):
    """Write `room.yaml` and `room.pgm`: a square of cells of 5 cm, of which the outermost are walls."""
    folder.mkdir(parents=True, exist_ok=True)
    gray = np.full((cells, cells), 254, dtype=np.uint8)
    gray[[0, -1], :] = gray[:, [0, -1]] = 0
    Image.fromarray(gray).save(folder / "room.pgm")
    (folder / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}\n")


SMALL_ROOM = """\
version: 1
metadata:
  name: small_room
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.0, yaw: 0.0}
      - goal_pose: {x: 3.0, y: 1.0, yaw: 0.0}
    variations:
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.02]
execution:
  runs: 2
"""
SHORT_DRIVES = """\
version: 1
metadata: {name: NAME}
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.5, yaw: 0.0}
      - goal_pose: {x: 1.6, y: 1.5, yaw: 0.0}
    variations:
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.01]
execution: {runs: 2, timeout: 30}
"""
"""Drives of 0.6 m in a room of 60 cells."""

PRODUCER = """
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer


class AheadParameters(Parameters):
    distances_m: tuple[float, ...]


class Ahead(Producer[AheadParameters]):
    Parameters = AheadParameters
    reads = ("map_file",)
    writes = {"start_pose": "task", "goal_pose": "task"}

    def produce(self, inputs, draws):
        for distance_m in self.parameters.distances_m:
            yield Fragment({"start_pose": pose(1.0), "goal_pose": pose(1.0 + distance_m)})


def pose(x_m):
    return {"position": {"x": x_m, "y": 1.5}, "orientation": {"yaw": 0.0}}
"""

ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


class DrivenParameters(Parameters):
    least_m: float


class Driven(Oracle[DrivenParameters]):
    Parameters = DrivenParameters
    metrics = {"distance": "m"}

    def judge(self, trace, situation):
        return self.passed(trace, distance=trace.run.distance_m)
"""


CAMPAIGN = """\
version: 1
metadata: {name: NAME}
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
    variations:
      - ahead.py:Ahead: {distances_m: DISTANCES}
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.01]
execution: {runs: 2, timeout: 30}
evaluation:
  oracles:
    - driven.py:Driven: {least_m: 0.1}
"""


def laid_out(folder, name, distances_m):
    """Write `<name>.vast` with a small room, `ahead.py:Ahead`, and `driven.py:Driven` beside it."""
    drawn_room(folder, 60)
    campaign = CAMPAIGN.replace("NAME", name).replace("DISTANCES", str(distances_m))
    for file, text in ((f"{name}.vast", campaign), ("ahead.py", PRODUCER), ("driven.py", ORACLE)):
        (folder / file).write_text(text)


def edited(folder, *edits):
    """Replace texts that occur once; edits are (file, old, new)."""
    for file, old, new in edits:
        text = (folder / file).read_text()
        assert text.count(old) == 1
        (folder / file).write_text(text.replace(old, new))
