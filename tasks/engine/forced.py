"""Forced stages: their stored results are removed when a call first asks for them, so that it computes them again."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

from vastflow.tasks.engine.index import ConfigurationRuns, Index
from vastflow.tasks.store.store import Store


@dataclass
class Forced:
    """Results that a call computes again although the store had them.

    Attributes:
        stages: `instantiate`, `execute`, `observe`, `judge`, or some of them.
        evaluations: Keys of the removed evaluations.
    """

    stages: Collection[str] = ()
    evaluations: set[str] = field(default_factory=set, repr=False)
    _asked: set[str] = field(default_factory=set, repr=False)
    _runs: dict[tuple[str, str], set[int]] = field(default_factory=dict, repr=False)
    _reached: dict[str, int] = field(default_factory=dict, repr=False)

    def runs(self, stage: str, configuration: ConfigurationRuns) -> frozenset[int]:
        """Return the run indices whose results of a stage were removed."""
        return frozenset(self._runs.get((stage, configuration.checked), ()))

    def remove_evaluations(self, store: Store, keys: Iterable[str]) -> None:
        """Remove the evaluations that this call did not ask for before."""
        if "instantiate" not in self.stages:
            return
        new = [key for key in keys if key not in self._asked]
        self._asked.update(new)
        there = [key for key in new if store.find(key) is not None]
        self.evaluations.update(there)
        store.remove(there)

    def remove_results(self, index: Index, configurations: Sequence[ConfigurationRuns]) -> None:
        """Remove results of the wanted runs of configurations that this call did not ask for before."""
        for configuration in configurations if self.stages else ():
            checked, keys = configuration.checked, []
            for stored in index.stored(configuration, self._reached.get(checked, 0)):
                found = {"execute": [stored.recordings.key], "observe": [], "judge": []}
                if stored.trace is not None:
                    verdicts = index.verdicts_key(configuration, stored.block, stored.trace.content)
                    found["observe"] = [stored.trace.key]
                    found["judge"] = [verdicts] * (stored.verdicts is not None) + [*index.held(verdicts)]
                for stage in filter(found.get, self.stages):
                    keys += found[stage]
                    span = range(stored.block.start, stored.block.stop)
                    self._runs.setdefault((stage, checked), set()).update(span)
            index.store.remove(keys)
            self._reached[checked] = max(configuration.runs, self._reached.get(checked, 0))
