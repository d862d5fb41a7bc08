"""Shards: configurations or evaluations that one Prefect task run computes. Prefect itself is not needed here."""

from collections.abc import Mapping, Sequence
from typing import Final

from vastflow.tasks.engine.evaluation import PackedProducer
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.engine.instantiation import Evaluation
from vastflow.tasks.keys.keys import Keys

MOST_TASK_RUNS: Final = 100
"""Maximum number of task runs of a stage: Prefect's recorder loses rows silently in the thousands."""

LEAST_RECORDED: Final = 16
"""Configurations of a shard of which all runs are recorded: Prefect spends more on a task run than judging some of them takes."""

MOST_NAMED: Final = 5
"""Configurations or keys that a task run names."""


class Shard:
    """Configurations that go through the stages together. No dataclass: Prefect would walk into it."""

    __slots__ = ("configurations",)

    def __init__(self, configurations: Sequence[ConfigurationRuns]) -> None:
        self.configurations = configurations

    @property
    def families(self) -> frozenset[str]:
        """Names of the families that the configurations are of."""
        return frozenset(configuration.family for configuration in self.configurations)

    def __str__(self) -> str:
        """`12–15 of hall`, or `hall 12 – depot 3` for several families."""
        first, last = self.configurations[0], self.configurations[-1]
        if first.family != last.family:
            return f"{first.family} {first.place} – {last.family} {last.place}"
        places = f"{first.place}" if first is last else f"{first.place}–{last.place}"
        return f"{places} of {first.family}"

    def about(self, keys: Keys) -> str:
        """Return names of configurations, number of runs, and keys of recordings; of many the first few."""
        names = [each.name for each in self.configurations]
        return _few(names, sum(each.runs for each in self.configurations), "run") + "".join(
            f"; {keys.recordings(each.checked)}" for each in self.configurations[:MOST_NAMED]
        )


class ProducerShard:
    """A producer on some of its distinct restricted inputs."""

    __slots__ = ("evaluations", "families", "name", "packed")

    def __init__(self, family: str, name: str, packed: PackedProducer, evaluations: Sequence[Evaluation]) -> None:
        self.families = frozenset((family,))
        self.name = name
        self.packed = packed
        self.evaluations = evaluations

    def __str__(self) -> str:
        return self.name

    def about(self, keys: Keys) -> str:
        """Return the producer, number of evaluations, and their keys; of many the first few."""
        shown = "".join(f"; {each.key}" for each in self.evaluations[:MOST_NAMED])
        return _few([self.name], len(self.evaluations), "evaluation") + shown


def _few(names: Sequence[str], count: int, unit: str) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f"{', '.join(names[:MOST_NAMED])}{more}, {count} {unit}{'s'[: count != 1]}"


def shard_ranges(count: int, least: int = 1) -> list[range]:
    """Return consecutive ranges of about equal size, at most `MOST_TASK_RUNS`, that have `count` positions together.

    Args:
        least: Positions of each range, if there are so many.
    """
    size = max(-(-count // MOST_TASK_RUNS), least)
    return [range(start, min(start + size, count)) for start in range(0, count, size)]


def missing_shards(configurations: Sequence[ConfigurationRuns], missing_runs: Mapping[str, int]) -> list[Shard]:
    """Return shards of the incomplete configurations.

    Args:
        missing_runs: Number of runs to execute by name of incomplete configurations; 0 where only observing or judging is due.
    """
    recorded = [each for each in configurations if missing_runs.get(each.name) == 0]
    absent = [each for each in configurations if missing_runs.get(each.name)]
    return [
        Shard(chosen[part.start : part.stop])
        for chosen, least in ((recorded, LEAST_RECORDED), (absent, 1))
        for part in shard_ranges(len(chosen), least)
    ]
