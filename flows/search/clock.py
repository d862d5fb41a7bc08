"""The clock of a search whose budget is time: which batches it paid for is kept, and repeated."""

import time
from dataclasses import dataclass, field
from typing import Any, Final

from vastflow.producers.campaign_file.search import SearchSpec
from vastflow.sim.model.digest import digest
from vastflow.tasks.store import Store

_BATCHES: Final = "batches"


@dataclass
class BatchClock:
    """Says how much of a budget of time is spent.

    Time alone makes no result. So the number of batches that it paid for the first time is kept in the store, and a search with the
    same key has as many.

    Attributes:
        key: Of this search in the store; empty where nothing of it depends on time.
    """

    store: Store
    key: str
    _began_s: float = field(default_factory=time.monotonic)

    def elapsed_s(self, batches: int, spec: SearchSpec) -> float:
        """Time spent after so many batches (s); where it is known how many it pays, all or nothing of the budget."""
        if not self.key:
            return 0.0
        if (kept := self._kept()) is None:
            return time.monotonic() - self._began_s
        return max(each.time or 0.0 for each in spec.budget) if batches >= kept else 0.0

    def keep(self, batches: int) -> None:
        """Keep how many batches there were, unless that is known."""
        if self.key and self._kept() is None:
            self.store.put(self.key, {}, {_BATCHES: batches})

    def _kept(self) -> int | None:
        found = self.store.find(self.key)
        return None if found is None else int(found.info[_BATCHES])


def clock_of(store: Store, spec: SearchSpec, *content: Any) -> BatchClock:
    """The clock of a search.

    Args:
        content: What its results follow from, in values that have a digest.
    """
    timed = any(each.time is not None for each in spec.budget)
    hashed = digest("search", *content)
    return BatchClock(store, f"search/{hashed[:2]}/{hashed}" if timed else "")
