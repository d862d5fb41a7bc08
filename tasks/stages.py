"""Prefect's side of the stages: one task run a shard and stage, with a Merkle key over its members.

A task's result is only what it promises: keys and content digests of artifacts. Before Prefect may answer `Cached`,
the key function looks whether the store still keeps the promise, and lets Prefect forget the result if not.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from prefect import Task, task
from prefect.context import TaskRunContext
from prefect.transactions import get_transaction

from vastflow.sim.digest import Value
from vastflow.tasks.evaluation import PackedProducer
from vastflow.tasks.instantiation import Evaluation
from vastflow.tasks.keys import merkle
from vastflow.tasks.shelf import Member
from vastflow.tasks.workshop import Rows, Workshop


class Shard:
    """Members that go through the stages together. No dataclass: Prefect would walk into it."""

    __slots__ = ("members",)

    def __init__(self, members: Sequence[Member]) -> None:
        self.members = members

    def __str__(self) -> str:
        """Such as `12–15 of hall`; in a shard of several families `hall 12 – depot 3`."""
        first, last = self.members[0], self.members[-1]
        if first.family != last.family:
            return f"{first.family} {first.place} – {last.family} {last.place}"
        places = f"{first.place}" if first is last else f"{first.place}–{last.place}"
        return f"{places} of {first.family}"


class ProducerShard:
    """A producer on some of its distinct restricted inputs."""

    __slots__ = ("evaluations", "name", "packed")

    def __init__(self, name: str, packed: PackedProducer, evaluations: Sequence[Evaluation]) -> None:
        self.name = name
        self.packed = packed
        self.evaluations = evaluations

    def __str__(self) -> str:
        return self.name


class Bench:
    """The workshop and where Prefect keeps results, handed to every task.

    Attributes:
        api: What the ledger of flow runs calls Prefect's API in use.
    """

    __slots__ = ("api", "results", "workshop")

    def __init__(self, workshop: Workshop, results: Path, api: str = "") -> None:
        self.workshop = workshop
        self.results = results
        self.api = api


def stored_in(bench: Bench, stage: "Task[Any, Any]") -> "Task[Any, Any]":
    """`stage` with its results in the folder of `bench`."""
    return stage.with_options(result_storage=bench.results)


def _evaluate_key(_: TaskRunContext, parameters: dict[str, Any]) -> str:
    bench, shard = parameters["bench"], parameters["shard"]
    keys = [each.key for each in shard.evaluations]
    return _checked(bench, merkle("evaluate", keys), keys)


def _execute_key(_: TaskRunContext, parameters: dict[str, Any]) -> str:
    bench, members = parameters["bench"], parameters["shard"].members
    shelf = bench.workshop.shelf
    promised: list[Value] = [[shelf.keys.recordings(member.scenario.digest), member.runs] for member in members]
    key = merkle("execute", promised)
    if not all(shelf.recorded(member) for member in members):
        _forget(bench, key)
    return key


def _observe_key(_: TaskRunContext, parameters: dict[str, Any]) -> str:
    bench = parameters["bench"]
    keys = bench.workshop.trace_keys(parameters["shard"].members, parameters["recorded"])
    return _checked(bench, merkle("observe", keys), keys)


def _judge_key(_: TaskRunContext, parameters: dict[str, Any]) -> str:
    bench = parameters["bench"]
    keys = bench.workshop.verdict_keys(parameters["shard"].members, parameters["observed"])
    return _checked(bench, merkle("judge", keys), keys)


def _checked(bench: Bench, key: str, promised: Sequence[str]) -> str:
    if any(bench.workshop.shelf.store.find(each) is None for each in promised):
        _forget(bench, key)
    return key


def _forget(bench: Bench, key: str) -> None:
    (bench.results / key).unlink(missing_ok=True)


def _whole(result: tuple[Rows, bool]) -> Rows:
    """The rows; those of a shard in which something is missing are not for Prefect to remember."""
    rows, complete = result
    if not complete:
        _keep_nothing()
    return rows


def _keep_nothing() -> None:
    transaction = get_transaction()
    if transaction is not None:
        transaction.write_on_commit = False


@task(
    name="instantiate",
    task_run_name="instantiate {shard}",
    cache_key_fn=_evaluate_key,
    persist_result=True,
    result_serializer="json",
)
def evaluate(shard: ProducerShard, bench: Bench) -> dict[str, str]:
    """Evaluate a producer; gives the errors by key."""
    errors = bench.workshop.evaluate(shard.packed, shard.evaluations)
    if errors:
        _keep_nothing()
    return errors


@task(
    name="execute",
    task_run_name="execute {shard}",
    cache_key_fn=_execute_key,
    persist_result=True,
    result_serializer="json",
)
def execute(shard: Shard, bench: Bench) -> Rows:
    """Execute a shard's missing runs."""
    return _whole(bench.workshop.execute(shard.members))


@task(
    name="observe",
    task_run_name="observe {shard}",
    cache_key_fn=_observe_key,
    persist_result=True,
    result_serializer="json",
)
def observe(shard: Shard, recorded: Rows, bench: Bench) -> Rows:
    """Observe a shard's recordings."""
    return _whole(bench.workshop.observe(shard.members, recorded))


@task(
    name="judge",
    task_run_name="judge {shard}",
    cache_key_fn=_judge_key,
    persist_result=True,
    result_serializer="json",
)
def judge(shard: Shard, observed: Rows, bench: Bench) -> Rows:
    """Judge a shard's traces."""
    return _whole(bench.workshop.judge(shard.members, observed))
