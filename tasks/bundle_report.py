"""What a flow run made of its bundle: told through the store in parts, so that nobody has to list the store to learn of it."""

import json
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from vastflow.tasks.artifact import artifact_of, manifest_of
from vastflow.tasks.bundle import STAGE
from vastflow.tasks.engine import Engine, MemberFault
from vastflow.tasks.index import Member
from vastflow.tasks.store import Artifact, Lost, Store

_PART: Final = "part.json"


@dataclass(frozen=True, slots=True)
class ReportPart:
    """News of one flow run.

    Attributes:
        artifacts: What is in the store of members that no earlier part told of.
        faults: What broke in the flow run.
        last: Whether no other part follows.
    """

    artifacts: tuple[Artifact, ...]
    faults: tuple[MemberFault, ...] = ()
    last: bool = False


class Report:
    """The report of this process's flow run, as it grows; any thread may add to it.

    Args:
        flow_run: Its id.
    """

    def __init__(self, engine: Engine, flow_run: str) -> None:
        self._engine = engine
        self._flow_run = flow_run
        self._parts = 0
        self._lock = threading.Lock()
        self._told: set[str] = set()

    def add(self, members: Sequence[Member], last: bool = False) -> None:
        """Tell of members that are through, of each once; with the last part, of what broke too.

        Raises:
            StoreError: the store can't be used.
        """
        with self._lock:
            news = [member for member in members if member.name not in self._told]
            if news or last:
                found = [each for member in news for each in self._engine.index.stored(member)]
                kept = [
                    artifact for each in found for artifact in (each.recordings, each.trace, each.verdicts) if artifact
                ]
                part = ReportPart(tuple(kept), self._engine.faults if last else (), last)
                write_part(self._engine.index.store, self._flow_run, self._parts, part)
                self._parts += 1
                self._told.update(member.name for member in news)


def write_part(store: Store, flow_run: str, number: int, part: ReportPart) -> None:
    """Keep a part, the first of number 0."""
    content = {
        "artifacts": [[each.key, manifest_of(each).decode()] for each in part.artifacts],
        "faults": [asdict(fault) for fault in part.faults],
        "last": part.last,
    }
    store.put(_key(flow_run, number), {_PART: json.dumps(content).encode()})


def read_part(store: Store, flow_run: str, number: int) -> ReportPart | None:
    """A part; None where it is not there yet, or lost: what is missing is tried again then."""
    key = _key(flow_run, number)
    store.changed(key)
    try:
        content: dict[str, Any] = json.loads(store.read(key, _PART))
    except Lost:
        return None
    artifacts = tuple(artifact_of(key, manifest.encode()) for key, manifest in content["artifacts"])
    return ReportPart(artifacts, tuple(MemberFault(**fault) for fault in content["faults"]), content["last"])


def _key(flow_run: str, number: int) -> str:
    return f"{STAGE}/reports/{flow_run}/{number}"
