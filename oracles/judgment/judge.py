"""Judging: verdicts and causes from blocks of recordings and traces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from vastflow.oracles.judgment.cause import Cause, cause_of
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.situation import Situation, situation_of
from vastflow.oracles.observation.trace import Trace, Unobserved, trace_of
from vastflow.sim.model.archive import read_outputs
from vastflow.sim.model.blocks import read_block, read_recordings
from vastflow.sim.model.recording import Outputs
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.plug_ins.effects import watched
from vastflow.sim.plug_ins.loading import snapshot_behind


@dataclass(frozen=True, slots=True)
class JudgedBlock:
    """Verdicts on a block of runs, run by run, and the causes of failed runs by index."""

    verdicts: list[Verdict]
    causes: Mapping[int, Cause]


def judge_block(
    scenario: Scenario,
    recording_block: bytes,
    trace_block: bytes,
    oracles: Sequence[Oracle[Any]],
    outputs: bytes | None = None,
    kept: Sequence[Verdict] = (),
) -> JudgedBlock:
    """Return every oracle's verdict on every run of a block, and the causes of failures.

    Args:
        recording_block: Runs of `scenario`, by `write_recordings`.
        trace_block: The same runs, by `observe_block`.
        outputs: Files of the runs' programs, by `write_outputs`.
        kept: Verdicts of other oracles on the same runs, each oracle's in their order.

    Raises:
        ValueError: the blocks are not of the same runs.
        PlugInError: a plug-in read a file that it does not declare.
    """
    situation = situation_of(scenario)
    recordings, observed = read_recordings(recording_block), read_block(trace_block)
    recorded = [recording.run.run_index for recording in recordings]
    if recorded != (traced := [row["run_index"] for row, _ in observed]):
        raise ValueError(f"recordings of runs {recorded} and traces of runs {traced} do not belong together")
    written = read_outputs(outputs) if outputs else {}
    traces = [
        trace_of(replace(recording, outputs=written.get(recording.run.run_index, Outputs())), row, columns)
        for recording, (row, columns) in zip(recordings, observed, strict=True)
    ]
    for columns in (columns for trace in traces for columns in (trace.columns, *trace.tables.values())):
        for column in columns.values():
            column.setflags(write=False)  # all oracles share them
    said_by: dict[str, list[Verdict]] = {}
    for verdict in kept:
        said_by.setdefault(verdict.oracle, []).append(verdict)
    for oracle in oracles:
        with watched(snapshot_behind(type(oracle))):
            said_by[oracle.name] = [*map(_with_origin, traces, _said(oracle, traces, situation))]
    said = list(zip(*said_by.values(), strict=True))
    causes = {
        trace.run.run_index: cause
        for trace, verdicts in zip(traces, said, strict=bool(said_by))
        if (cause := cause_of(trace, verdicts)) is not None
    }
    return JudgedBlock([verdict for verdicts in said for verdict in verdicts], causes)


def _said(oracle: Oracle[Any], traces: Sequence[Trace], situation: Situation) -> list[Verdict]:
    try:
        return oracle.judge_all(traces, situation)
    except Unobserved as error:  # by a recorded run, which is the only one of its block
        return [oracle.not_judged(trace, str(error)) for trace in traces]


def _with_origin(trace: Trace, verdict: Verdict) -> Verdict:
    """Return a verdict that says where the pose is from, if that is the robot's estimate."""
    if not trace.run.estimated_by:
        return verdict
    origin = f"the pose is the robot's estimate: {trace.run.estimated_by}"
    return replace(verdict, reason="; ".join(filter(None, [verdict.reason, origin])))
