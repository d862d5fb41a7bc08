"""Units of workers: one stage, or all, of one block of runs, from the store and into it.

Simulator, oracles, and producers are imported when they are needed, so that a worker starts fast. Nothing raises but
`StoreError`: errors are answers, and nothing is stored then.
"""

import importlib.metadata
import json
import logging
import os
import platform
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, ParamSpec, TypeAlias, TypeVar

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.tasks.engine.evaluation import FRAGMENTS, PackedProducer, write_evaluation
from vastflow.tasks.engine.executor import Shared
from vastflow.tasks.engine.index import run_blocks
from vastflow.tasks.engine.machine_check import check_temporary
from vastflow.tasks.engine.process import few_collections
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import Artifact, Lost, Store, StoreError

if TYPE_CHECKING:
    from vastflow.sim.model.recording import Recording

WorkStage: TypeAlias = Literal["instantiate", "execute", "observe", "judge", "flow"]

RECORDINGS: Final = "recordings.parquet"
BEHAVIORS: Final = "behaviors.arrow"
OUTPUTS: Final = "outputs.zip"
TRACES: Final = "traces.parquet"
VERDICTS: Final = "verdicts.json"
RUN_LOG: Final = "runlog.json"

LOGGER: Final = logging.getLogger("vastflow.work")

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Broken:
    """The cause why a run or block has no result, in one line.

    Attributes:
        died: True if its worker process died.
    """

    error: str
    died: bool = False


@dataclass(frozen=True, slots=True)
class Executed:
    """The outcome of a block.

    Attributes:
        simulated_s: Run index to simulated time of the stored runs.
        broken: Run index to the cause of the others.
        took_s: Wall time.
        artifacts: Recordings, traces, and verdicts that are stored now; empty if it was only executed.
    """

    simulated_s: Mapping[int, float]
    broken: Mapping[int, Broken]
    took_s: float = field(default=0.0, compare=False)
    artifacts: tuple[Artifact, ...] = ()


def broken(error: BaseException) -> Broken:
    """Return an error as a value, and print the traceback unless a scenario's author can mend it."""
    words = " ".join(str(error).split())
    if isinstance(error, ScenarioError):
        return Broken(words[:500])
    traceback.print_exception(error)
    return Broken(f"{type(error).__name__}: {words}"[:500])


def answered(function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T | Broken | None:
    """Call `function`, and return errors as answers, because the caller may lack their classes.

    Returns:
        Its result; None if an input is lost.

    Raises:
        StoreError: the store, or the folder for temporary files, can't be used by any job.
    """
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    try:
        with plug_in_code():
            return function(*arguments, **named)
    except Lost as error:
        LOGGER.warning("%s", error)
        return None
    except StoreError:
        raise
    except Exception as error:  # noqa: BLE001 - a plug-in may raise anything, and the campaign goes on
        if isinstance(error, OSError):
            check_temporary(error)
        return broken(error)


def compile_kernels(systems: Sequence[Mapping[str, Value]] = ({},)) -> None:
    """Drive a meter through an empty room to fill the kernel cache for other workers.

    Args:
        systems: System dimensions, one for each controller.
    """
    from vastflow.sim.run import run
    from vastflow.sim.world.environment import MAP_KEY
    from vastflow.sim.world.world import map_content

    with few_collections(), tempfile.TemporaryDirectory() as folder:
        room = Path(folder, "room.yaml")
        # A room is enough: kernels are compiled for types and shapes of parameters, not for maps.
        cells = bytes(0 if x in (0, 59) or y in (0, 59) else 254 for y in range(60) for x in range(60))
        Path(folder, "room.pgm").write_bytes(b"P5 60 60 255\n" + cells)
        room.write_text("{image: room.pgm, resolution: 0.05, origin: [0, 0, 0]}")
        poses: dict[str, Value] = {
            "start_pose": {"position": {"x": 1.0, "y": 1.5}, "orientation": {"yaw": 0.0}},
            "goal_pose": {"position": {"x": 2.0, "y": 1.5}, "orientation": {"yaw": 0.0}},
        }
        for system in systems:
            run(Scenario("builtin:navigate_to_pose", 20.0, {MAP_KEY: map_content(room)}, poses, system), 0, 0)


def execute(store: Store, key: str, scenario: Scenario, start: int, stop: int, seed: int) -> Executed:
    """Execute runs `start` to `stop` - 1 of a scenario, and store the finished ones in contiguous blocks.

    A stored block is not executed again: another worker may have died before its answer arrived.
    """
    began_s = time.monotonic()
    if (stored := store.find(f"{key}/{start}-{stop}")) is not None:
        return Executed({int(run): float(s) for run, s in stored.info["runs"]}, {})
    from vastflow.sim import run
    from vastflow.sim.model.recording import run_log_row
    from vastflow.sim.run import Execution

    whole: list[Execution] = []
    simulated_s: dict[int, float] = {}
    errors: dict[int, Broken] = {}

    def keep() -> None:
        if whole:
            recordings = [execution.recording for execution in whole]
            times = {recording.run.run_index: recording.run.simulated_s for recording in recordings}
            store.put(
                f"{key}/{min(times)}-{max(times) + 1}",
                _files(recordings),
                {"runs": [list(run) for run in times.items()]},
                {RUN_LOG: _run_log({e.recording.run.run_index: run_log_row(e.log) for e in whole})},
            )
            simulated_s.update(times)
        whole.clear()

    for run_index in range(start, stop):
        executed = answered(run.execute, scenario, run_index, seed)
        if isinstance(executed, Execution):
            whole.append(executed)
        else:
            # A broken run ends the block before it: files hold contiguous runs, and the ones that are done are kept.
            errors[run_index] = executed or Broken("an artifact that it needs is lost")
            keep()
    keep()
    return Executed(simulated_s, errors, time.monotonic() - began_s)


def compute(
    store: Store, keys: Keys, checked: str, scenario: Scenario, start: int, stop: int, oracles: Shared
) -> Executed:
    """Execute, observe, and judge runs `start` to `stop` - 1 of a scenario with the stages' arguments.

    What can't be observed or judged is left to these stages, which say so.

    Args:
        checked: See `vastflow.sim.reading.checked.checked_digest`.
    """
    began_s = time.monotonic()
    home = keys.recordings(checked)
    executed = execute(store, home, scenario, start, stop, keys.seed)
    artifacts: list[Artifact] = []
    for block in run_blocks(sorted(executed.simulated_s), stop - start):
        if (recordings := store.find(f"{home}/{block[0]}-{block[1]}")) is None:
            continue
        artifacts.append(recordings)
        trace_key = keys.trace(checked, recordings.content)
        if (trace := store.find(trace_key)) is None:
            answered(observe, store, recordings.key, trace_key, scenario)
            trace = store.find(trace_key)
        if trace is not None:
            artifacts.append(trace)
            verdicts_key = keys.verdicts(checked, recordings.content, trace.content)
            if (verdicts := store.find(verdicts_key)) is None:
                arguments = (store, recordings.key, trace_key, verdicts_key, scenario, oracles, keys.by_oracle)
                answered(judge, *arguments)
                verdicts = store.find(verdicts_key)
            artifacts += [verdicts] if verdicts else []
    return Executed(executed.simulated_s, executed.broken, time.monotonic() - began_s, tuple(artifacts))


def observe(store: Store, recording_key: str, key: str, scenario: Scenario) -> None:
    """Observe one block of recordings and store the trace."""
    from vastflow.oracles.observation.observe import observe_block

    store.put(key, {TRACES: observe_block(scenario, store.read(recording_key, RECORDINGS))})


def judge(
    store: Store,
    recording_key: str,
    trace_key: str,
    key: str,
    scenario: Scenario,
    oracles: Shared,
    keyed: Mapping[str, str],
    held: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Judge one block and store the verdicts, with the judgment of each run and the causes of failures.

    Args:
        oracles: Pickled, so that a plug-in that can't be imported is an error of this unit alone.
        keyed: See `Keys.by_oracle`.
        held: See `Index.held`; these oracles do not judge again.
    """
    from vastflow.oracles.judgment.judge import judge_block
    from vastflow.oracles.judgment.verdict import Verdict, read_verdicts, run_judgment, write_verdicts

    kept: list[Verdict] = []
    for beside, names in (held or {}).items():
        with suppress(Lost):  # those judge again
            kept += [each for each in read_verdicts(store.read(beside, VERDICTS)) if each.oracle in names]
    known = {verdict.oracle for verdict in kept}
    recordings, traces = store.read(recording_key, RECORDINGS), store.read(trace_key, TRACES)
    recorded = store.find(recording_key)
    outputs = store.load(recorded, OUTPUTS) if recorded is not None and OUTPUTS in recorded.files else None
    judging = [oracle for oracle in oracles() if oracle.name not in known]
    judged = judge_block(scenario, recordings, traces, judging, outputs, kept)
    said: dict[int, list[Any]] = {}
    for verdict in judged.verdicts:
        said.setdefault(verdict.run_index, []).append(verdict.judgment)
    together = [[run_index, run_judgment(judgments)] for run_index, judgments in said.items()]
    causes = [list(each) for each in judged.causes.items()]
    info = {"runs": together, "causes": causes, "oracles": dict(keyed)}
    # The order in which oracles are asked is in no key.
    verdicts = sorted(judged.verdicts, key=lambda verdict: (verdict.run_index, verdict.oracle))
    store.put(key, {VERDICTS: write_verdicts(verdicts)}, info)


def evaluate(store: Store, key: str, producer: PackedProducer, inputs: Mapping[str, Value]) -> None:
    """Evaluate a producer on one restricted input and store the result."""
    from vastflow.producers.floorplan.environment import FOLDER, environments_in
    from vastflow.producers.model import producer as producers

    with environments_in(store.local / FOLDER):
        found = producers.evaluate(producer.unpacked(), inputs)
    store.put(key, {FRAGMENTS: write_evaluation(found)})


def _files(recordings: "Sequence[Recording]") -> dict[str, bytes]:
    from vastflow.sim.model.archive import write_behaviors, write_outputs
    from vastflow.sim.model.blocks import write_recordings

    behaviors = write_behaviors({recording.run.run_index: recording.behaviors for recording in recordings})
    files = {RECORDINGS: write_recordings(recordings), BEHAVIORS: behaviors}
    outputs = {r.run.run_index: r.outputs for r in recordings if r.outputs.tables or r.outputs.files}
    return {**files, OUTPUTS: write_outputs(outputs)} if outputs else files


def _run_log(runs: Mapping[int, Mapping[str, Any]]) -> bytes:
    """Return host, versions, and costs of a block's runs, which are in no digest."""
    versions = {name: importlib.metadata.version(name) for name in ("vastflow", "numpy", "numba", "pymunk")}
    host = {"name": platform.node(), "machine": platform.machine(), "python": platform.python_version()}
    content = {
        "runs": [{"run_index": run_index, **row} for run_index, row in runs.items()],
        "host": host,
        "versions": versions,
        "pid": os.getpid(),
    }
    return json.dumps(content, separators=(",", ":")).encode()
