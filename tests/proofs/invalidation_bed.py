"""A campaign with every ingredient of a key, and a copy of vastflow's source.

What its calls compute is counted: the program, the producer, the oracle and the notebook write lines into a file each time they are
called; traces and verdicts are counted as artifacts that are new, as are the runs in which a robot drives.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Final

CHILD: Final = Path(__file__).with_name("invalidation_child.py")
PACKAGES: Final = ("sim", "producers", "oracles", "tasks", "flows", "campaigns.scenarios")

VAST: Final = """
version: 1
metadata:
  name: invalidation
configuration:
  - name: room
    parameters:
      - base: 1
      - sut.program.gain: 2
    variations:
      - own.py:Own: {map_file: maps/room.yaml, factor: 2}
execution:
  scenario_file: drive.osc
  run_files:
    - program.py
  config_files: {program: program.yaml}
  runs: 2
  timeout: 60
evaluation:
  oracles:
    - judge.py:Judge: {limit: 5}
    - look.ipynb: {most: 7}
"""

DRIVEN: Final = """
version: 1
metadata:
  name: driven
configuration:
  - name: room
    parameters:
      - map_file: maps/hall.yaml
      - start_pose: {x: 0.8, y: 0.8, yaw: 0.0}
      - goal_pose: {x: 1.4, y: 0.8, yaw: 0.0}
execution:
  nav2_params: nav2.yaml
  runs: 2
"""

LOG: Final = 'with open("LOG.looked", "a") as log:\n    log.write("x\\n" * len(runs["run_index"]))'
LOOK: Final = 'files = ["look.txt"]\nmetrics = {"look": "1"}\nlook = int(open("look.txt").read())'
SAY: Final = 'verdicts = [{"run_index": i, "judgment": "pass", "look": look} for i in runs["run_index"].to_pylist()]'
CELLS: Final = (
    ("markdown", {}, "Looks."),
    ("code", {"tags": ["parameters"]}, "most = 3"),
    ("code", {}, LOOK),
    ("code", {}, LOG),
    ("code", {}, SAY),
)
NOTEBOOK: Final = {
    "nbformat": 4,
    "nbformat_minor": 5,
    "metadata": {},
    "cells": [{"cell_type": kind, "metadata": of, "outputs": [], "source": source} for kind, of, source in CELLS],
}

FILES: Final[Mapping[str, str]] = {
    "x.vast": VAST,
    "driven.vast": DRIVEN,
    "nav2.yaml": "amcl:\n  ros__parameters: {alpha1: 0.3}\n",
    "maps/hall.yaml": "{image: hall.pgm, resolution: 0.1, origin: [0.0, 0.0, 0.0]}\n",
    "maps/hall.pgm": "P2 24 16 255\n" + "254 " * (24 * 16) + "\n",
    "drive.osc": """import osc.helpers

scenario drive:
    timeout(60s)
    value: string = "1"

    do serial:
        run_process("python3 program.py " + value)
""",
    "program.yaml": "gain: 1\nother: 1\n",
    "program.py": """import sys
with open("LOG.executed", "a") as log:
    log.write("x\\n")
with open("out.csv", "w") as table:
    table.write(f"t_s,value\\n0.0,{sys.argv[1]}\\n")
""",
    "own.py": """from pydantic import Field
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.places.ground import MapParameter
from vastflow.producers.model.producer import Parameters, Producer
from pathlib import Path
from values import VALUES


class OwnParameters(Parameters):
    map_file: MapParameter = None
    factor: int = 1


class Own(Producer[OwnParameters]):
    Parameters = OwnParameters
    files = ["offset.txt"]
    reads = ("base",)
    writes = {"value": "system"}

    def produce(self, inputs, draws):
        with open("LOG.evaluated", "a") as log:
            log.write("x\\n")
        offset = int(Path(__file__).with_name("offset.txt").read_text())
        for value in VALUES:
            yield Fragment({"value": str(inputs["base"] + offset + self.parameters.factor * value)})
""",
    "values.py": "VALUES = [1, 2]\n",
    "offset.txt": "0",
    "judge.py": '''"""A judge."""
import httpx  # which it has for its version
from pathlib import Path
from pydantic import Field
from vastflow.oracles.judgment.oracle import Oracle, Parameters
from limits import HIGHEST
from lib.deep import LOWEST


class JudgeParameters(Parameters):
    limit: float = 3


class Judge(Oracle[JudgeParameters]):
    """Judges."""

    Parameters = JudgeParameters
    metrics = {"value": "1"}
    files = ["data/*.txt"]

    def judge(self, trace, situation):
        """Judge."""
        with open("LOG.judged", "a") as log:
            log.write("x\\n")
        table = Path(__file__).parent / "data" / "table.txt"
        value = float(table.read_text()) + HIGHEST + LOWEST + self.parameters.limit
        return self.passed(trace, value=value)
''',
    "limits.py": "HIGHEST = 3\n",
    "lib/__init__.py": "",
    "lib/deep.py": "from .deeper import DEEP\n\nLOWEST = DEEP\n",
    "lib/deeper.py": "DEEP = 1\n",
    "data/table.txt": "1",
    "look.txt": "1",
    "look.ipynb": json.dumps(NOTEBOOK),
    "maps/room.yaml": "{image: room.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}\n",
    "maps/room.pgm": "P2 4 4 255\n" + "254 254 254 254\n" * 4,
}

COUNTED: Final = ("evaluated", "executed", "observed", "judged", "looked", "gathered")
RUNS: Final = 4
BLOCKS: Final = 4
"""So many blocks they are: one of each run, as the last runs of a campaign have blocks of their own."""
DRIVES: Final = 2
"""Runs of the campaign in which a robot drives."""


@dataclass
class Bed:
    """A campaign, vastflow's source and a store, in a folder.

    Attributes:
        environment: Variables of the calls.
        options: Options of the child process.
        vast: The campaign file.
        meanwhile: An edit after keys are made.
    """

    folder: Path
    environment: dict[str, str] = field(default_factory=dict)
    options: list[str] = field(default_factory=list)
    meanwhile: "Callable[[Bed], None] | None" = None
    broken: list[str] = field(default_factory=list)
    campaign: str = "campaign"
    vast: str = "x.vast"

    def file(self, name: str) -> Path:
        """A file of the campaign."""
        return self.folder / self.campaign / name

    def source(self, name: str) -> Path:
        """A file of vastflow, such as `sim/run.py`."""
        return self.folder / "src" / "vastflow" / name

    def path(self, name: str) -> Path:
        """A file of the campaign, or of vastflow where the name begins so."""
        return self.source(name.removeprefix("vastflow/")) if name.startswith("vastflow/") else self.file(name)

    def write(self, name: str, text: str) -> None:
        """Write a file of the campaign."""
        file = self.file(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text.replace("LOG.", f"{self.folder.parent}/log."))

    def replace(self, name: str, old: str, new: str) -> None:
        """Edit a file of the campaign."""
        replaced(self.file(name), old, new)

    def counted(self) -> dict[str, int]:
        """Compute the campaign, and count what is done."""
        before = self._totals()
        command = [sys.executable, str(CHILD), str(self.file(self.vast)), str(self.folder / "store"), *self.options]
        command += ["--wait"] if self.meanwhile else []
        environment = {**os.environ, "PYTHONPATH": str(self.folder / "src"), **self.environment}
        with subprocess.Popen(
            command, env=environment, cwd=self.folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as child:
            if self.meanwhile:
                assert child.stdout is not None
                while (line := child.stdout.readline()) and line != "keyed\n":
                    pass
                self.meanwhile(self)
            said, _ = child.communicate("\n")
        if child.returncode:
            raise RuntimeError(f"the call ended with {child.returncode}")
        self.broken = json.loads(said.splitlines()[-1])
        return {name: after - before[name] for name, after in self._totals().items()}

    def _totals(self) -> dict[str, int]:
        logs = {name: self.folder.parent / f"log.{name}" for name in COUNTED if name not in ("observed", "gathered")}
        lines = {name: log.read_text().count("x") if log.exists() else 0 for name, log in logs.items()}
        driven = {"executed": self._blocks("execute")} if self.vast != "x.vast" else {}
        return {**lines, **driven, "observed": self._blocks("observe"), "gathered": self._blocks("judge")}

    def _blocks(self, stage: str) -> int:
        return len(list((self.folder / "store" / stage).rglob("manifest")))

    @classmethod
    def made(cls, folder: Path) -> "Bed":
        """A new one: the campaign is written and vastflow's source copied; nothing is computed."""
        bed = cls(folder)
        for name, text in FILES.items():
            bed.write(name, text)
        top = find_spec("vastflow")
        if top is not None and top.origin is not None:  # else the installed package is found in its place
            bed.source("").mkdir(parents=True)
            for module in Path(top.origin).parent.glob("*.py"):
                shutil.copy(module, bed.source(module.name))
        for package in PACKAGES:
            spec = find_spec(f"vastflow.{package}")
            assert spec is not None and spec.submodule_search_locations
            shutil.copytree(
                next(iter(spec.submodule_search_locations)),
                bed.source(package.replace(".", "/")),
                ignore=shutil.ignore_patterns("__pycache__"),
            )
        return bed

    def restored(self, pristine: Path) -> None:
        """Be as another one was when that was computed."""
        for part in ("src", "campaign", "store"):
            shutil.rmtree(self.folder / part, ignore_errors=True)
            shutil.copytree(pristine / part, self.folder / part)
        if self.campaign != "campaign":
            shutil.rmtree(self.folder / self.campaign, ignore_errors=True)
        self.environment, self.options, self.meanwhile, self.campaign, self.vast = {}, [], None, "campaign", "x.vast"


def replaced(file: Path, old: str, new: str) -> None:
    """Edit a file."""
    text = file.read_text(encoding="utf-8")
    if old not in text:
        raise ValueError(f"{file} has no {old!r}")
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def appended(file: Path, text: str) -> None:
    """Add to the end of a file."""
    file.write_text(file.read_text(encoding="utf-8") + text, encoding="utf-8")


def verdicts(bed: Bed) -> list[str]:
    """Return the metrics of the campaign's oracles, without the duration of programs."""
    files = (bed.folder / "store" / "judge").glob("*/*/verdicts.json")
    own = [row for file in files for row in json.loads(file.read_text()) if row["oracle"] != "success"]
    return sorted(f"{row['oracle']} {row['metrics']}" for row in own)
