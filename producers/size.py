"""The size of a campaign: how many configurations and runs its file asks for, before any of them is made."""

import math
from collections.abc import Sequence
from typing import Final

from vastflow.producers.faults import Fault, Location
from vastflow.producers.growth import InstantiableFamily
from vastflow.producers.vast.document import Document
from vastflow.producers.vast.repetition import Sequential
from vastflow.producers.vast.spec import ExecutionSpec

_RUNS: Final[Location] = ("execution", "runs")


def most_configurations(family: InstantiableFamily) -> int:
    """Configurations that a family asks for at most, as far as its producers tell: every combination of their choices.

    A design takes some of the combinations, so of a family with one it is the choices of its largest producer.
    """
    choices = [producer.most_choices or 1 for producer in family.producers]
    return math.prod(choices) if family.design.cartesian is not None else max(choices, default=1)


def size_faults(document: Document, families: Sequence[InstantiableFamily], execution: ExecutionSpec) -> list[Fault]:
    """More configurations or runs than the file permits, each with the number and the key that permits it."""
    asked = [most_configurations(family) for family in families]
    total, permitted = sum(asked), execution.max_configurations
    if total > permitted:
        largest = max(range(len(asked)), key=asked.__getitem__)
        where = document.known(("configuration", largest, "variations"))
        what = f"asks for {total:,} configurations" + (f", {max(asked):,} of them here" if max(asked) < total else "")
        return [document.fault(where, what, _right(permitted, "max_configurations", total), "key")]
    each = execution.runs.max if isinstance(execution.runs, Sequential) else execution.runs
    return runs_faults(document, total, execution, each)


def runs_faults(document: Document, configurations: int, execution: ExecutionSpec, runs: int) -> list[Fault]:
    """So many runs of each of so many configurations, where they are more than the file permits."""
    total = runs * configurations
    if total <= execution.max_runs:
        return []
    what = f"asks for {total:,} runs, {runs:,} of each configuration"
    return [document.fault(document.known(_RUNS), what, _right(execution.max_runs, "max_runs", total), "key")]


def _right(permitted: int, key: str, total: int) -> str:
    return f"at most {permitted:,}, or 'execution: {{{key}: {total}}}'"
