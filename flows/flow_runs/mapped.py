"""The stages of a campaign, each mapped over shards as task runs of the flow run round it.

Where there is nothing to map, Prefect is not imported.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vastflow.flows.flow_runs.task_runs import TaskRuns
from vastflow.tasks.engine.evaluation import packed
from vastflow.tasks.engine.instantiation import EvaluationRequest, Instantiated, Instantiator
from vastflow.tasks.engine.shards import ProducerShard, Shard, shard_ranges

if TYPE_CHECKING:
    from prefect.futures import PrefectFuture


def instantiate(task_runs: TaskRuns, instantiator: Instantiator) -> Instantiated:
    """Evaluate each producer once per distinct input.

    C^i = { c ⊕ f : c ∈ C^{i-1}, f ∈ p_i(c) }

    Raises:
        FileError: a constraint can't be evaluated, constraints leave nothing, or a design is too large.
        Lost: an evaluation is damaged.
    """

    def evaluated(requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        shards = [shard for request in requests for shard in _producer_shards(request)]
        return {key: error for future in task_runs.map("evaluate", shards) for key, error in future.result().items()}

    return instantiator.instantiated(evaluated)


def compute(task_runs: TaskRuns, shards: Sequence[Shard]) -> None:
    """Execute, observe, and judge shards, each through all stages as soon as possible, and wait for all."""
    recordings: list[PrefectFuture[Any]] = []
    traces: list[PrefectFuture[Any]] = []
    verdicts: list[PrefectFuture[Any]] = []
    for shard in shards:
        recordings += task_runs.map("execute", [shard])
        traces += task_runs.map("observe", [shard], recordings[-1:])
        verdicts += task_runs.map("judge", [shard], traces[-1:])
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
