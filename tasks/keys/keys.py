"""Keys: a digest of all that the content of an artifact follows from."""

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

from vastflow.sim.model.digest import Value, digest, file_digest
from vastflow.tasks.store.source_files import SourceFiles

LAYOUT: Final = 1
"""Version of the form in which `vastflow.tasks.engine.work` writes artifacts."""

EXECUTE_SOURCE: Final = (
    "vastflow.sim.run",
    "vastflow.sim.model.archive",
    "vastflow.sim.model.blocks",
    "vastflow.sim.nav2.controllers.*",
    "vastflow.sim.nav2.planners.*",
    "vastflow.sim.world.*",
)
_RADII: Final = "vastflow.sim.nav2.costmaps.outline"
"""Loaded by an entry point, which no import names: traces and verdicts follow from the robot's radii."""

OBSERVE_SOURCE: Final = ("vastflow.oracles.observation.observe", _RADII)
JUDGE_SOURCE: Final = ("vastflow.oracles.judgment.judge", _RADII)
EVALUATE_SOURCE: Final = ("vastflow.producers.model.producer",)

_TOGETHER_DIGITS: Final = 32

_NUMBA: Final = "NUMBA_"
_NUMBA_THAT_ONLY_SAYS: Final = (
    *("CACHE", "COLOR_SCHEME", "DEVELOPER_MODE", "DISABLE_PERFORMANCE_WARNINGS", "DUMP_", "FULL_TRACEBACKS"),
    *("NUM_THREADS", "SHOW_HELP", "THREADING_LAYER", "WARNINGS"),
)
"""Beginnings of Numba's settings, after `NUMBA_`, that change no compiled code; every other one may."""
_NUMBA_FILE: Final = ".numba_config.yaml"
"""Numba reads it in the working directory."""


@dataclass(frozen=True)
class Keys:
    """Makes the keys of one campaign's artifacts: `<stage>/<two digits>/<digest>`.

    Keys of verdicts end with a digest of the oracles. What is before it is the same for any oracles, so that verdicts of those that
    are asked again are found beside.

    Attributes:
        numeric: See `numeric_class`.
        execute_source, observe_source, judge_source: Source digests of the stages, without that of an oracle.
        seed: `execution.seed`.
        oracles: Name, and digest of source and parameters, of each oracle, in order.
        sources: Files behind the source digests; None where nothing is computed under these keys.
    """

    numeric: str
    execute_source: str
    observe_source: str
    judge_source: str
    seed: int
    oracles: Sequence[tuple[str, str]]
    sources: SourceFiles | None = field(default=None, compare=False, repr=False)

    @property
    def identity(self) -> str:
        """Digest of all in the keys of recordings, traces, and verdicts but scenarios and contents."""
        return digest(
            *(LAYOUT, self.numeric, self.execute_source, self.observe_source, self.judge_source, self.seed),
            [list(oracle) for oracle in self.oracles],
        )

    @cached_property
    def by_oracle(self) -> Mapping[str, str]:
        """Return `oracles` as a mapping; no verdict depends on their order."""
        return dict(self.oracles)

    @cached_property
    def _together(self) -> str:
        return digest(self.by_oracle)[:_TOGETHER_DIGITS]

    def recordings(self, scenario: str) -> str:
        """Key above the blocks of a scenario's runs, independent of their number.

        Args:
            scenario: `vastflow.sim.reading.checked.checked_digest` of the scenario, here and below.
        """
        return self._key("execute", self.execute_source, scenario, self.seed)

    def trace(self, scenario: str, recording: str) -> str:
        """Key of the trace of one block; `recording` is the content digest of the block."""
        return self._key("observe", self.observe_source, scenario, recording)

    def verdicts(self, scenario: str, recording: str, trace: str) -> str:
        """Key of the verdicts on one block; `recording` and `trace` are content digests."""
        return f"{self._key('judge', self.judge_source, scenario, recording, trace)}-{self._together}"

    def evaluation(self, source: str, producer: str, parameters: Value, inputs: str) -> str:
        """Key of a producer's evaluation, by its source digest, name, and parameters, and the input's digest."""
        return self._key("evaluate", source, producer, parameters, inputs)

    def _key(self, stage: str, *content: Value) -> str:
        hashed = digest(LAYOUT, stage, self.numeric, *content)
        return f"{stage}/{hashed[:2]}/{hashed}"


def numeric_class(machine: str | None = None, environment: Mapping[str, str] | None = None) -> str:
    """Return the properties that hosts share if they compute the same bits; arguments default to this host's.

    They are the architecture, and settings of Numba by which kernels are compiled otherwise. C libraries, processors, and versions of
    Python make no difference: functions whose last bits depend on them are not used (`vastflow.sim.model.elementary`).
    """
    machine = platform.machine() if machine is None else machine
    environment = os.environ if environment is None else environment
    forced = [
        f"{name}={environment[name]}" for name in sorted(filter(_changes_kernels, environment)) if environment[name]
    ]
    if Path(_NUMBA_FILE).is_file():
        forced.append(f"{_NUMBA_FILE}={file_digest(_NUMBA_FILE)}")
    return "; ".join([machine, *forced])


def _changes_kernels(variable: str) -> bool:
    return variable.startswith(_NUMBA) and not variable.removeprefix(_NUMBA).startswith(_NUMBA_THAT_ONLY_SAYS)
