"""The index: the artifacts of a campaign that are in the store, and the missing ones."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from vastflow.sim.model.scenario import Scenario
from vastflow.sim.reading.checked import checked_digest
from vastflow.sim.world.environment import GROUND_KEYS
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import Block, Stored
from vastflow.tasks.store.store import Artifact, Store


@dataclass(frozen=True, slots=True)
class ConfigurationRuns:
    """A distinct scenario of a campaign with its wanted runs.

    Attributes:
        name: Its configuration's name.
        place: Its number among the configurations of its family, from 1.
        runs: Run indices 0 to runs - 1 are wanted.
    """

    name: str
    family: str
    place: int
    scenario: Scenario
    runs: int

    @property
    def checked(self) -> str:
        """Digest of all that its runs are computed from, which is part of every key."""
        return checked_digest(self.scenario)

    @property
    def drives(self) -> bool:
        """True if a robot drives in it, which takes compiled kernels: without a map or a world nothing does."""
        return not self.scenario.environment.keys().isdisjoint(GROUND_KEYS)


@dataclass(frozen=True, slots=True)
class FoundRuns:
    """A configuration with its wanted runs, and the store's artifacts of them."""

    configuration: ConfigurationRuns
    stored: tuple[Stored, ...] = ()

    @property
    def missing_runs(self) -> int:
        """Number of wanted runs that are not recorded."""
        return len(missing([each.block for each in self.stored], self.configuration.runs))

    @property
    def complete(self) -> bool:
        """True if every wanted run is recorded, and every recorded block judged."""
        return all(each.verdicts for each in self.stored) and not self.missing_runs


@dataclass(frozen=True, slots=True)
class Index:
    """Places of a campaign's artifacts; each question looks into the store."""

    store: Store
    keys: Keys
    _beside: dict[str, Mapping[str, Sequence[str]]] = field(default_factory=dict, init=False, repr=False, compare=False)
    _oracles: dict[str, Mapping[str, str]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def stored(self, configuration: ConfigurationRuns, since: int | None = None) -> list[Stored]:
        """Return all artifacts of a configuration's wanted runs.

        Args:
            since: Return those of every block that begins at this run or later, also where blocks overlap.
        """
        found = []
        for artifact, block in self._recorded(configuration, since):
            trace = self.store.find(self.trace_key(configuration, block))
            verdicts = lacking = None
            if trace is not None:
                key = self.verdicts_key(configuration, block, trace.content)
                verdicts = self.store.find(key)
                held = {key: self.keys.by_oracle} if verdicts else self.held(key)
                lacking = frozenset(self.keys.by_oracle).difference(*held.values())
            found.append(Stored(block, artifact, trace, verdicts, lacking))
        return found

    def held(self, key: str) -> dict[str, list[str]]:
        """Return oracles whose verdicts on the block of a key of verdicts are in other artifacts, by their keys.

        Folders are listed once: verdicts of other oracles are from campaigns before.
        """
        folder, _, name = key.rpartition("/")
        if folder not in self._beside:
            listed: dict[str, list[str]] = {}
            for each in self.store.under(folder):
                listed.setdefault(each.partition("-")[0], []).append(each)
            self._beside[folder] = listed
        wanted = self.keys.by_oracle
        found: dict[str, list[str]] = {}
        for each in self._beside[folder].get(name.partition("-")[0], ()):
            oracles = self._together(f"{folder}/{each}") if wanted and each != name else {}
            there = wanted.items() & oracles.items()
            if there and self.store.find(f"{folder}/{each}") is not None:
                found[f"{folder}/{each}"] = sorted(oracle for oracle, _ in there)
                wanted = dict(wanted.items() - there)
        return found

    def _together(self, key: str) -> Mapping[str, str]:
        """Return the oracles of a key of verdicts, which all keys with this end share."""
        end = key.rpartition("-")[2]
        if end not in self._oracles and (artifact := self.store.find(key)) is not None:
            self._oracles[end] = artifact.info.get("oracles") or {}
        return self._oracles.get(end, {})

    def blocks(self, configuration: ConfigurationRuns) -> list[Block]:
        """Return recorded blocks that together cover most of the wanted runs."""
        return [block for _, block in self._recorded(configuration)]

    def _recorded(self, configuration: ConfigurationRuns, since: int | None = None) -> list[tuple[Artifact, Block]]:
        home = self.keys.recordings(configuration.checked)
        spans, runs, found = _spans(self.store.under(home)), configuration.runs, []
        for start, stop in _covering(spans, runs) if since is None else spans:
            if not (since or 0) <= start < runs:
                continue
            if (artifact := self.store.find(f"{home}/{start}-{stop}")) is not None:
                found.append((artifact, Block(artifact.key, start, stop, artifact.content)))
        return found

    def block(self, configuration: ConfigurationRuns, start: int, stop: int, content: str) -> Block:
        """Return the block of these runs, found before."""
        return Block(f"{self.keys.recordings(configuration.checked)}/{start}-{stop}", start, stop, content)

    def trace_key(self, configuration: ConfigurationRuns, block: Block) -> str:
        return self.keys.trace(configuration.checked, block.content)

    def verdicts_key(self, configuration: ConfigurationRuns, block: Block, trace: str) -> str:
        """Return the key of the verdicts on a block; `trace` is the content digest of its trace."""
        return self.keys.verdicts(configuration.checked, block.content, trace)


def missing(blocks: Iterable[Block], runs: int) -> list[int]:
    """Return the wanted run indices that no block has, in order."""
    there = {run for block in blocks for run in range(block.start, block.stop)}
    return [run for run in range(runs) if run not in there]


def run_blocks(runs: Sequence[int], most: int) -> list[tuple[int, int]]:
    """Run indices in order as (start, stop) of consecutive ones, none longer than `most`."""
    parts: list[tuple[int, int]] = []
    for run in runs:
        if parts and parts[-1][1] == run and run - parts[-1][0] < most:
            parts[-1] = (parts[-1][0], run + 1)
        else:
            parts.append((run, run + 1))
    return parts


def _spans(names: Iterable[str]) -> Iterator[tuple[int, int]]:
    for name in names:
        start, _, stop = name.partition("-")
        if start.isdigit() and stop.isdigit():
            yield int(start), int(stop)


def _covering(spans: Iterable[tuple[int, int]], runs: int) -> list[tuple[int, int]]:
    """Return the spans that add runs, from the left, as campaigns may cut the same runs differently."""
    chosen: list[tuple[int, int]] = []
    reached = 0
    for start, stop in sorted(spans, key=lambda span: (span[0], -span[1])):
        if start < runs and stop > reached:
            chosen.append((start, stop))
            reached = stop
    return chosen
