"""The stages of a campaign, each mapped over shards as task runs of the flow run round it.

Where there is nothing to map, Prefect is not imported.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from vastflow.flows.flow_runs.task_runs import TaskRuns
from vastflow.tasks.engine.engine import Rows
from vastflow.tasks.engine.evaluation import packed
from vastflow.tasks.engine.instantiation import EvaluationRequest, Instantiated, Instantiator
from vastflow.tasks.engine.shards import ProducerShard, Shard, shard_ranges

if TYPE_CHECKING:
    from prefect.futures import PrefectFuture

Made: TypeAlias = "Sequence[PrefectFuture[Any]] | Sequence[Rows]"
"""Of each shard what a stage made, or will have made."""


def instantiate(task_runs: TaskRuns, instantiator: Instantiator) -> Instantiated:
    """C^i = { c ⊕ f : c ∈ C^{i-1}, f ∈ p_i(c) }: each producer is evaluated once for each of its distinct inputs.

    Raises:
        FileError: a constraint can't be evaluated, constraints leave nothing, or a design is too large.
        Lost: an evaluation is damaged.
    """

    def evaluated(requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        shards = [shard for request in requests for shard in _producer_shards(request)]
        return {key: error for future in task_runs.map("evaluate", shards) for key, error in future.result().items()}

    return instantiator.instantiated(evaluated)


def execute(task_runs: TaskRuns, shards: Sequence[Shard]) -> "list[PrefectFuture[Any]]":
    """Execute the missing runs of shards."""
    return task_runs.map("execute", shards)


def observe(task_runs: TaskRuns, shards: Sequence[Shard], recordings: Made) -> "list[PrefectFuture[Any]]":
    """Observe the recordings of shards, each as soon as it is there."""
    return task_runs.map("observe", shards, recordings)


def judge(task_runs: TaskRuns, shards: Sequence[Shard], traces: Made) -> "list[PrefectFuture[Any]]":
    """Judge the traces of shards, each as soon as they are there."""
    return task_runs.map("judge", shards, traces)


def compute(task_runs: TaskRuns, shards: Sequence[Shard]) -> None:
    """Execute, observe and judge shards, each through all stages as soon as it can be, and wait for all."""
    recordings: list[PrefectFuture[Any]] = []
    traces: list[PrefectFuture[Any]] = []
    verdicts: list[PrefectFuture[Any]] = []
    for shard in shards:
        recordings += execute(task_runs, [shard])
        traces += observe(task_runs, [shard], recordings[-1:])
        verdicts += judge(task_runs, [shard], traces[-1:])
    task_runs.wait(shards, recordings, traces, verdicts)


def _producer_shards(request: EvaluationRequest) -> list[ProducerShard]:
    evaluations, sent = request.evaluations, packed(request.producer)
    name = f"{request.family} by {type(request.producer).__name__}"
    parts = shard_ranges([each.key.rpartition("/")[2] for each in evaluations])
    if len(parts) == 1:
        return [ProducerShard(request.family, name, sent, evaluations)]
    return [
        ProducerShard(
            request.family, f"{name}, {_places(part)} of {len(evaluations)}", sent, [evaluations[i] for i in part]
        )
        for part in parts
    ]


def _places(part: range) -> str:
    return f"{part.start + 1}" if len(part) == 1 else f"{part.start + 1}–{part.stop}"
