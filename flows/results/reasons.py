"""Reasons why a stage or a producer has work, by comparison with the previous campaign."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Literal

from vastflow.flows.request.run_request import asked_of
from vastflow.flows.results.past import PARTS, Past, values_of, writers, written_scenario
from vastflow.flows.results.provenance import (
    STAGES,
    DueReason,
    ReasonKind,
    Stage,
    change_text,
    changes,
    evaluation_ingredients,
    few,
    short_text,
    stage_ingredients,
    value_changes,
)
from vastflow.flows.results.tables import configuration_row
from vastflow.oracles.results.schema import Row, json_text
from vastflow.producers.instantiation.instantiate import Family
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.model.producer import Producer
from vastflow.tasks.engine.forced import Forced
from vastflow.tasks.engine.index import ConfigurationRuns, missing
from vastflow.tasks.engine.instantiation import Evaluation
from vastflow.tasks.store.artifact import Stored

FORCED: Final = DueReason("forced", "forced")
NEVER: Final = DueReason("never computed", "never computed before, as far as is known")
_DIMENSION_AND_KEY: Final = re.compile(rf"(?:{'|'.join(PARTS)})\.[^.\[]+")


@dataclass(frozen=True, slots=True)
class Step:
    """Something that a run would find in the store, or compute.

    Attributes:
        subject: A configuration; at `instantiate` a producer.
        amount: Runs of it; at `instantiate` one evaluation. 0 where no oracle judges and only causes follow.
        reason: Why it would be computed; None where it is in the store.
    """

    stage: Stage
    family: str
    subject: str
    amount: int
    reason: DueReason | None


class Reasons:
    """Why evaluations of producers and runs of configurations are computed.

    Args:
        past: The campaign before, if there is one.
        today: Current ingredients, as `metadata.json` would record them.
        forced: Work to repeat although the store has its results.

    Attributes:
        configurations: All of today, by name; set when they are known.
    """

    def __init__(
        self, past: Past | None, today: Mapping[str, Any], families: Sequence[Family], forced: Forced | None = None
    ) -> None:
        self.configurations: Mapping[str, Configuration] = {}
        self.forced = forced or Forced()
        self._past = past
        self._today = today
        self._families = {family.name: family for family in families}
        self._of_stage: dict[tuple[Stage, frozenset[str] | None], DueReason | None] = {}
        self._texts: dict[tuple[str, tuple[str, ...]], set[str]] = {}

    def evaluation(self, family: str, producer: Producer[Any], evaluation: Evaluation) -> DueReason:
        """Why the evaluation of a producer of `family` is not in the store."""
        inputs = evaluation.inputs
        if evaluation.key in self.forced.evaluations:
            return FORCED
        if self._past is None:
            return NEVER
        name = type(producer).__name__
        rows = self._past.metadata["producers"].get(family)
        if rows is None:
            return DueReason("producer changed", f"family {family} is new")
        place = next(k for k, each in enumerate(self._families[family].producers) if each is producer)
        today = self._today["producers"][family]
        ordinal = [row["name"] for row in today[:place]].count(name)
        namesakes = [row for row in rows if row["name"] == name]  # the k-th of a name was the k-th of that name
        if ordinal >= len(namesakes):
            return DueReason("producer changed", f"{name} is new in {family}")
        then = evaluation_ingredients(self._past.metadata, namesakes[ordinal])
        now = evaluation_ingredients(self._today, today[place])
        if changed := all_of([*changes(then, now)]):
            return changed
        if json_text(inputs) in self._known(self._past, family, *inputs):
            return lost(self._past)
        fresh = ", ".join(self._fresh(self._past, family, inputs))
        return DueReason("input changed", f"what {name} reads changed", fresh or "values that were not together before")

    def execute(self, configuration: ConfigurationRuns, runs: Sequence[int]) -> list[tuple[DueReason, int]]:
        """Reasons for these runs, each with its number of runs."""
        forced = self.forced.runs("execute", configuration)
        absent = [run for run in runs if run not in forced]
        again = [(FORCED, len(runs) - len(absent))]
        return again + self._execute(configuration, absent)

    def _execute(self, configuration: ConfigurationRuns, absent: Sequence[int]) -> list[tuple[DueReason, int]]:
        if self._past is None or not absent:
            return [(NEVER, len(absent))]
        row = self._past.by_key.get(configuration.checked)
        if row is None:
            return [(self._scenario(self._past, self.configurations[configuration.name]), len(absent))]
        return list(Counter(self._run(self._past, row, configuration, run) for run in absent).items())

    def later(
        self,
        stage: Literal["observe", "judge"],
        configuration: ConfigurationRuns,
        oracles: frozenset[str] | None = None,
    ) -> DueReason:
        """The reason why a recorded block is observed, or an observed block is judged, maybe by some oracles only."""
        if self._past is None:
            return NEVER
        if configuration.checked not in self._past.by_key:
            return DueReason(
                "never computed", "recorded, but never more", "as a campaign that was interrupted leaves it"
            )
        return self._stage(self._past, stage, oracles) or lost(self._past)

    def gathered(self, configuration: ConfigurationRuns) -> DueReason:
        """The reason why causes follow anew, for a block whose verdicts are all in the store."""
        why = None
        if self._past is not None and configuration.checked in self._past.by_key:
            why = self._stage(self._past, "judge")
        if why is None:
            why = DueReason("oracle changed", "these oracles were not asked together")
        return DueReason(why.kind, str(why), "all verdicts are in the store, only causes of failures follow anew")

    def _run(self, past: Past, row: Row, configuration: ConfigurationRuns, run: int) -> DueReason:
        before = past.runs_of(row["name"])
        if run >= before:
            return DueReason("more runs", "more runs are asked", f"{before} before, now {configuration.runs}")
        if changed := self._stage(past, "execute"):
            return changed
        if (row["name"], run) in past.recorded:
            return lost(past)
        return DueReason("broke", "not recorded in the campaign before", "its metadata.json says which fault it was")

    def _stage(self, past: Past, stage: Stage, oracles: frozenset[str] | None = None) -> DueReason | None:
        """Why the past has no result of today in a stage or of oracles; None if nothing changed."""
        if (stage, oracles) not in self._of_stage:
            then, now = (stage_ingredients(each, stage, oracles) for each in (past.metadata, self._today))
            self._of_stage[stage, oracles] = all_of([*changes(then, now)])
        return self._of_stage[stage, oracles]

    def _scenario(self, past: Past, configuration: Configuration) -> DueReason:
        if same := past.by_digest.get(configuration.scenario.digest):
            what = "what vastflow or a plug-in makes of the same scenario changed"
            return DueReason("scenario changed", what, "" if same["name"] == configuration.name else same["name"])
        now = configuration_row(configuration)
        namesake = past.by_name.get(configuration.name)
        if namesake is not None and namesake["scenario_digest"] not in self._scenarios:  # else it has another name now
            return scenario_reason(namesake, now)
        asked = asked_of(past.metadata)
        if asked.only or asked.sample is not None:
            said = [*asked.only, *([] if asked.sample is None else [f"a sample of {asked.sample}"])]
            return DueReason("new configuration", "the campaign before was only a selection", ", ".join(said))
        if not self._known(past, configuration.family):
            return DueReason("new configuration", f"family {configuration.family} is new")
        values = {key: value for key, value in values_of(now).items() if not key.startswith("_")}
        fresh = [f"{key} = {short_text(values[key])}" for key in self._fresh(past, configuration.family, values)]
        words = f"first with {few(fresh)}" if fresh else "of values that were not together before"
        return DueReason("new configuration", "new configuration", words)

    @cached_property
    def _scenarios(self) -> set[str]:
        return {each.scenario.digest for each in self.configurations.values()}

    def _fresh(self, past: Past, family: str, values: Mapping[str, Any]) -> list[str]:
        """The keys with values that no configuration of the family had."""
        return [key for key in values if json_text({key: values[key]}) not in self._known(past, family, key)]

    def _known(self, past: Past, family: str, *keys: str) -> set[str]:
        """Values of these keys together, of all configurations that the family had, as text."""
        if (family, keys) not in self._texts:
            rows = (values_of(row) for row in past.rows if row["family"] == family)
            self._texts[family, keys] = {json_text({key: each[key] for key in keys if key in each}) for each in rows}
        return self._texts[family, keys]


def lost(past: Past) -> DueReason:
    """Something is not in the store that the campaign before had there."""
    return DueReason("lost", "not in this store, though an earlier campaign had it", past.directory.name)


def scenario_reason(then: Row, now: Row) -> DueReason:
    """Describe the differences between the scenarios of a row and an earlier row."""
    found = [*value_changes(written_scenario(then), written_scenario(now))]
    # dimension and key of each path into the scenario; the path itself outside of dimensions
    keys = list(dict.fromkeys(key[0] if (key := _DIMENSION_AND_KEY.match(path)) else path for path, _, _ in found))
    who = writers(now)
    by = dict.fromkeys(filter(None, (who.get(key.partition(".")[2]) for key in keys)))
    writer = f" (written by {', '.join(by)})" if by else ""
    details = [
        change_text(path if len(keys) > 1 else path.removeprefix(keys[0]).lstrip("."), a, b) for path, a, b in found
    ]
    return DueReason("scenario changed", f"{few(keys)} changed{writer}", few(details))


def all_of(reasons: Sequence[DueReason]) -> DueReason | None:
    """Merge several reasons; the first gives the kind."""
    if len(reasons) < 2:
        return reasons[0] if reasons else None
    return DueReason(reasons[0].kind, "; ".join(map(str, reasons)))


def run_steps(
    configuration: ConfigurationRuns, certain: int, stored: Sequence[Stored], reasons: Reasons | None = None
) -> Iterator[Step]:
    """Yield the steps of a configuration, without `reasons` those alone that need none.

    Runs from `certain` on are executed only if it is undecided by then.
    """
    recorded, observed, judged, gathered = set[int](), set[int](), set[int](), False
    lacking: dict[int, frozenset[str] | None] = {}
    for each in stored:
        span = range(each.block.start, min(each.block.stop, configuration.runs))
        recorded.update(span)
        observed.update(span if each.trace else ())
        if each.verdicts or each.lacking == frozenset():
            judged.update(span)
            gathered = gathered or not each.verdicts
        elif each.trace:
            lacking.update(dict.fromkeys(span, each.lacking))
    amounts: list[tuple[Stage, int, DueReason | None]] = [
        ("execute", len(recorded), None),
        ("observe", len(observed), None),
        ("judge", len(judged), None),
    ]
    if reasons is not None:
        absent = missing([each.block for each in stored], configuration.runs)
        due = [run for run in absent if run < certain]
        if absent:
            amounts += [("execute", amount, reason) for reason, amount in reasons.execute(configuration, due)]
            open_ = DueReason("open", f"open until judged{' again' * bool(recorded)}")
            amounts.append(("execute", len(absent) - len(due), open_))
        follows = _FOLLOWS_EXECUTE if absent else _FOLLOWS_OBSERVE
        executed, observes, judges = (reasons.forced.runs(stage, configuration) for stage in STAGES[1:])
        executes, unobserved, unjudged = executed & {*absent}, recorded - observed, observed - judged
        untraced = unobserved.union(absent)
        amounts += [
            ("observe", len(untraced & observes), FORCED),
            ("observe", len(executes - observes), _UNLESS_RECORDED),
            ("observe", len({*absent} - executes - observes), _FOLLOWS_EXECUTE),
            ("judge", len((untraced | unjudged) & judges), FORCED),
            ("judge", len(executes - judges), _UNLESS_RECORDED),
            ("judge", len((untraced & observes) - executes - judges), _UNLESS_TRACED),
            ("judge", len(untraced - observes - executes - judges), follows),
        ]
        if unobserved := unobserved - observes:
            amounts.append(("observe", len(unobserved), reasons.later("observe", configuration)))
        for oracles, amount in Counter(lacking.get(run) for run in unjudged - judges).items():
            amounts.append(("judge", amount, reasons.later("judge", configuration, oracles)))
    for stage, amount, why in amounts:
        if amount:
            yield Step(stage, configuration.family, configuration.name, amount, why)
    if gathered and reasons is not None:
        yield Step("judge", configuration.family, configuration.name, 0, reasons.gathered(configuration))


_FOLLOWS_EXECUTE: Final = DueReason("follows", "follows from execute")
_FOLLOWS_OBSERVE: Final = DueReason("follows", "follows from observe")
_UNLESS_RECORDED: Final = DueReason("follows", "follows from execute, unless recordings come out as before")
_UNLESS_TRACED: Final = DueReason("follows", "follows from observe, unless traces come out as before")


@dataclass
class Why:
    """Due work of a stage and family with one reason.

    Attributes:
        subjects: Configurations, or at `instantiate` producers, in order.
        detail: Detail of the first subject's reason.
        alike: Whether all subjects have this detail.
    """

    stage: Stage
    family: str
    kind: ReasonKind
    what: str
    detail: str
    alike: bool = True
    amount: int = 0
    subjects: dict[str, None] = field(default_factory=dict)

    def __str__(self) -> str:
        if self.kind == "open":
            return f"{self.what}, at most {self.amount}"
        if not self.detail:
            return self.what
        return f"{self.what}{':' if self.alike else f', such as {next(iter(self.subjects))}'} {self.detail}"


def whys(steps: Sequence[Step]) -> list[Why]:
    """Group due work by stage, family, and reason."""
    found: dict[tuple[str, str, str, str], Why] = {}
    for each in steps:
        if (reason := each.reason) is None:
            continue
        key = each.stage, each.family, reason.kind, reason.what
        why = found.setdefault(key, Why(each.stage, each.family, reason.kind, reason.what, reason.detail))
        why.alike = why.alike and why.detail == reason.detail
        why.amount += each.amount
        why.subjects[each.subject] = None
    return sorted(found.values(), key=lambda why: STAGES.index(why.stage))
