"""Reasons: why a stage has to compute something, told from the campaign before."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

from vastflow.flows.request.asked import asked_of
from vastflow.flows.results.origin import other_parts
from vastflow.flows.results.origin_code import ENTRIES, code_changes
from vastflow.flows.results.past import PARTS, Past, contents, value_changes, values_of, writers
from vastflow.flows.results.tables import Row, configuration_row, json_text
from vastflow.producers.configuration import Configuration
from vastflow.producers.faults import shown
from vastflow.tasks.index import Member
from vastflow.tasks.keys import Keys
from vastflow.tasks.source import SourceTree

Kind: TypeAlias = Literal[
    "never computed",
    "new configuration",
    "scenario changed",
    "more runs",
    "producer changed",
    "input changed",
    "oracle changed",
    "seed changed",
    "source changed",
    "numeric class changed",
    "lost",
    "broke",
    "follows",
]

MOST_COMPARED: Final = 50
"""Configurations that went away, and new ones, up to which it is looked for which came of which."""
_MOST_SHOWN: Final = 3


@dataclass(frozen=True, slots=True)
class DueReason:
    """Why something is computed.

    Attributes:
        what: In a few words that are the same for much of a campaign.
        detail: What is special about this one; may be empty.
    """

    kind: Kind
    what: str
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.what}: {self.detail}" if self.detail else self.what


NEVER: Final = DueReason("never computed", "never computed before, as far as is known")


class Origins:
    """What of the code, the machine, the seed and the oracles is other than it was in the past.

    Args:
        today: What `metadata.json` would say now, as `vastflow.flows.results.origin_code.code_row` has it.
        plug_ins: Classes of the campaign's oracles.
    """

    def __init__(
        self, past: Past, tree: SourceTree, keys: Keys, today: Mapping[str, Any], plug_ins: Iterable[type]
    ) -> None:
        self._then = past.metadata
        self._tree = tree
        self._keys = keys
        self._today = today
        self._plug_ins = tuple(plug_ins)
        self._known: dict[str, list[DueReason]] = {}

    def reasons(self, stage: Literal["execute", "observe", "judge"]) -> list[DueReason]:
        """Why no result of the past is one of today in this stage; empty where every one is."""
        if stage not in self._known:
            self._known[stage] = [*self._reasons(stage)]
        return self._known[stage]

    def code(self, plug_in: type) -> list[str]:
        """What changed of the code behind a plug-in of the tree, see `code_changes`."""
        return code_changes(self._then.get("code", {}), self._tree.plug_in_code(plug_in))

    def stage_code(self, stage: str) -> list[str]:
        """What changed of the code of a stage."""
        return code_changes(self._then.get("code", {}), self._tree.code(*ENTRIES[stage]))

    def numeric(self) -> DueReason | None:
        """Whether the machine is of another numeric class."""
        then = self._then.get("numeric_class", self._keys.numeric)
        if then == self._keys.numeric:
            return None
        return DueReason(
            "numeric class changed", "numeric class changed", "; ".join(other_parts(then, self._keys.numeric))
        )

    def _reasons(self, stage: str) -> Iterator[DueReason]:
        if numeric := self.numeric():
            yield numeric
        seed = self._then.get("seed", self._keys.seed)
        if stage == "execute" and seed != self._keys.seed:
            yield DueReason("seed changed", "execution.seed changed", f"from {seed} to {self._keys.seed}")
        oracles = [*self._oracles()] if stage == "judge" else []
        yield from oracles
        now = getattr(self._keys, f"{stage}_source")
        if self._then.get("source", {}).get(stage, now) != now:
            found = self.stage_code(stage)
            if found or not oracles:
                yield DueReason("source changed", f"source of {stage} changed", "; ".join(found) or _UNKNOWN)

    def _oracles(self) -> Iterator[DueReason]:
        if "oracles" not in self._then:
            return
        then = {each["name"]: each for each in self._then["oracles"]}
        now = {each["name"]: each for each in self._today["oracles"]}
        for name in [*then, *(name for name in now if name not in then)]:
            if name not in now or name not in then:
                yield DueReason("oracle changed", f"oracle {name} is {'gone' if name in then else 'new'}")
                continue
            if then[name]["parameters"] != now[name]["parameters"]:
                words = parameter_changes(then[name]["parameters"], now[name]["parameters"])
                yield DueReason("oracle changed", f"parameters of oracle {name} changed", words)
            if then[name]["source"] != now[name]["source"]:
                plug_in = self._plug_ins[[*now].index(name)]
                own = ["its file"] if then[name]["file"] != now[name]["file"] else []
                words = "; ".join([*own, *self.code(plug_in)]) or _UNKNOWN
                yield DueReason("source changed", f"source of oracle {name} changed", words)
        if list(then) != list(now) and sorted(then) == sorted(now):
            yield DueReason("oracle changed", "the oracles' order changed")


_UNKNOWN: Final = "the campaign before does not say in which module"


class RunReasons:
    """Why runs of configurations are computed.

    Args:
        past: The campaign before; None where there is none.
        origins: What changed since; None without a past.
        configurations: Of today, all of them.
    """

    def __init__(self, past: Past | None, origins: Origins | None, configurations: Sequence[Configuration]) -> None:
        self._past = past
        self._origins = origins
        self._configurations = {each.name: each for each in configurations}
        self._came_of: dict[str, Row] = {}
        self._values: dict[str, dict[str, set[str]]] = {}
        if past is not None:
            self._pair(past)

    def execute(self, member: Member, absent: Sequence[int]) -> list[tuple[DueReason, int]]:
        """Reasons for these runs, each with how many it is of."""
        if self._past is None or self._origins is None:
            return [(NEVER, len(absent))]
        row = self._past.by_digest.get(member.scenario.digest)
        if row is None:
            return [(self._scenario(self._past, member), len(absent))]
        counted = Counter(self._run(self._past, self._origins, row, member, run) for run in absent)
        return list(counted.items())

    def later(self, stage: Literal["observe", "judge"], member: Member) -> DueReason:
        """Why a block that is recorded is observed, or one that is observed is judged."""
        if self._past is None or self._origins is None:
            return NEVER
        if member.scenario.digest not in self._past.by_digest:
            return DueReason(
                "never computed", "recorded, but never more", "as a campaign that was interrupted leaves it"
            )
        return _all_of(self._origins.reasons(stage)) or _lost(self._past)

    def _run(self, past: Past, origins: Origins, row: Row, member: Member, run: int) -> DueReason:
        before = past.runs_of(row["name"])
        if run >= before:
            return DueReason("more runs", "more runs are asked", f"{before} before, now {member.runs}")
        if changed := _all_of(origins.reasons("execute")):
            return changed
        if (row["name"], run) in past.recorded:
            return _lost(past)
        return DueReason("broke", "not recorded in the campaign before", "its metadata.json says which fault it was")

    def _pair(self, past: Past) -> None:
        """Find out of which configuration, no longer there, each one came that is new: of the most like it."""
        today = {each.scenario.digest for each in self._configurations.values()}
        gone: dict[str, list[Row]] = {}
        new: dict[str, list[Row]] = {}
        for digest, row in past.by_digest.items():
            if digest not in today:
                gone.setdefault(row["family"], []).append(row)
        for each in self._configurations.values():
            if each.scenario.digest not in past.by_digest and each.family in gone:
                new.setdefault(each.family, []).append(configuration_row(each))
        for family, rows in new.items():
            self._came_of.update(_pairs(gone[family], rows))

    def _scenario(self, past: Past, member: Member) -> DueReason:
        configuration = self._configurations[member.name]
        now = configuration_row(configuration)
        if member.name in self._came_of:
            return scenario_reason(self._came_of[member.name], now)
        asked = asked_of(past.metadata)
        if asked.only or asked.sample is not None:
            said = [*asked.only, *([] if asked.sample is None else [f"a sample of {asked.sample}"])]
            return DueReason("new configuration", "the campaign before was only a selection", ", ".join(said))
        known = self._known(past, member.family)
        if not known:
            return DueReason("new configuration", f"family {member.family} is new")
        values = {key: value for key, value in values_of(now).items() if not key.startswith("_")}
        fresh = [
            f"{key} = {_short(value)}" for key, value in values.items() if json_text(value) not in known.get(key, ())
        ]
        words = f"first with {_few(fresh)}" if fresh else "of values that were not together before"
        return DueReason("new configuration", "new configuration", words)

    def _known(self, past: Past, family: str) -> Mapping[str, set[str]]:
        """Key to the values, as text, that configurations of the family had; empty where there were none."""
        if family not in self._values:
            self._values[family] = {}
            for row in past.rows:
                if row["family"] == family:
                    for key, value in values_of(row).items():
                        self._values[family].setdefault(key, set()).add(json_text(value))
        return self._values[family]


def _pairs(gone: Sequence[Row], new: Sequence[Row]) -> dict[str, Row]:
    """Name of a new configuration to the one it came of, each once; among many only the namesake is looked at."""
    if len(gone) * len(new) > MOST_COMPARED**2:
        namesakes = {row["name"]: row for row in gone}
        return {row["name"]: namesakes[row["name"]] for row in new if row["name"] in namesakes}
    likeness = [
        (len(differing(then, now)), then["name"] != now["name"], k, i)
        for k, now in enumerate(new)
        for i, then in enumerate(gone)
    ]
    found: dict[int, int] = {}
    for _, _, k, i in sorted(likeness):
        if k not in found and i not in found.values():
            found[k] = i
    return {new[k]["name"]: gone[i] for k, i in found.items()}


def scenario_reason(then: Row, now: Row) -> DueReason:
    """What makes the scenario of a row of `configurations.parquet` another than that of an earlier row."""
    found = differing(then, now)
    parts = list(dict.fromkeys(part for part, _, _, _ in found))
    keys = list(dict.fromkeys(re.split(r"[.\[]", path)[0] if part else path for part, path, _, _ in found))
    who = writers(now)
    by = dict.fromkeys(who[key] for key in keys if key in who)
    where = f" in {', '.join(filter(None, parts))}" if any(parts) else ""
    writer = f" (written by {', '.join(by)})" if by else ""
    alone = len(found) == 1 and found[0][1] in keys
    details = [change_text("" if alone else path, a, b) for _, path, a, b in found]
    return DueReason("scenario changed", f"{_few(keys)} changed{where}{writer}", _few(details))


def differing(then: Row, now: Row) -> list[tuple[str, str, Any, Any]]:
    """Dimension, path, old and new value of all that differs in the scenarios of two rows; what is in none has no dimension."""
    found: list[tuple[str, str, Any, Any]] = []
    if then["abstract"] != now["abstract"]:
        found.append(("", "abstract scenario", then["abstract"], now["abstract"]))
    if then["timeout_s"] != now["timeout_s"]:
        found.append(("", "execution.timeout", then["timeout_s"], now["timeout_s"]))
    old, new = contents(then), contents(now)
    for part in PARTS:
        found += [(part, path, a, b) for path, a, b in value_changes(old[part], new[part])]
    if old.get("programs") != new.get("programs"):
        found.append(("", "programs", old.get("programs"), new.get("programs")))
    return found


def _lost(past: Past) -> DueReason:
    return DueReason("lost", "not in this store, though an earlier campaign had it", past.directory.name)


def _all_of(reasons: Sequence[DueReason]) -> DueReason | None:
    """Several reasons as one; the first gives the kind."""
    if len(reasons) < 2:
        return reasons[0] if reasons else None
    return DueReason(reasons[0].kind, "; ".join(map(str, reasons)))


def parameter_changes(then: Any, now: Any) -> str:
    """What differs in two plain values, in words."""
    return _few([change_text(path, a, b) for path, a, b in value_changes(then, now)])


def change_text(path: str, then: Any, now: Any) -> str:
    """One of `vastflow.flows.results.past.value_changes` in words: `x from 1 to 2`, `values gained 3, lost 4`."""
    if isinstance(then, list) and isinstance(now, list):
        gained = [_short(item) for item in now if item not in then]
        lost = [_short(item) for item in then if item not in now]
        words = [f"gained {_few(gained)}"] * bool(gained) + [f"lost {_few(lost)}"] * bool(lost)
        return " ".join(filter(None, [path, ", ".join(words) or "in another order or number"]))
    return " ".join(filter(None, [path, f"from {_short(then)} to {_short(now)}"]))


def _few(words: Sequence[str]) -> str:
    more = len(words) - _MOST_SHOWN
    return ", ".join(words) if more <= 0 else f"{', '.join(words[:_MOST_SHOWN])} and {more} more"


def _short(value: Any) -> str:
    if isinstance(value, Mapping) and value.keys() == {"file"}:
        return f"file {str(value['file'])[:12]}"
    if isinstance(value, float):
        text = f"{value:.10g}"
        return f"{text}.0" if text.removeprefix("-").isdigit() else text
    return shown(value)
