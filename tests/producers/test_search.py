"""The search section: what is right, what is wrong with it and where, and what of it can't be run here."""

from collections.abc import Callable
from pathlib import Path

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.producers.faults import CampaignError
from vastflow.producers.vast.search import Budget, NoImprovement, SearchSpec
from vastflow.producers.vast.search_template import marker_of

FILE = """\
version: 1
execution: {{scenario_file: scenario.osc, runs: 3}}
search:
  strategy: {strategy}
  search_space:
    gain: {domain}
    wind: {{type: float, low: 0, high: 12}}
  variations:
  - {variation}
  extract: {{plugin: {extract}}}
  objectives: [{{name: failure_rate, direction: maximize}}]
  per_batch: 8
  budget: {budget}
  stopping: {stopping}
"""
SCENARIO = """\
import osc.helpers

scenario fly:
    gain: string
    force: string
    do serial:
        run_process('fly ' + gain + ' ' + force)
"""
GOOD = {
    "strategy": "random",
    "domain": "{type: float, low: 0.3, high: 3}",
    "variation": "ParameterVariationList: {name: force, values: [$wind]}",
    "extract": "failure_rate",
    "budget": "[{batches: 4}]",
    "stopping": "[]",
}
Said = Callable[..., list[str]]


@pytest.fixture
def said(tmp_path: Path) -> Said:
    """What is said of a search with some parts replaced, without the file's name; why it can't be run if it has no fault."""

    def faults(**parts: str) -> list[str]:
        (tmp_path / "scenario.osc").write_text(SCENARIO)
        (tmp_path / "wind.py").write_text("raise SystemExit('nothing of a plug-in runs here')\nclass Wind: ...\n")
        file = tmp_path / "c.vast"
        file.write_text(FILE.format(**{**GOOD, **parts}))
        try:
            found = list(load_campaign(file).unexecutable)
        except CampaignError as error:
            found = list(error.faults)
        return [str(fault).removeprefix(f"{file}:") for fault in found]

    return faults


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"domain": "{type: int, low: 1, high: 9, step: 2}"},
        {"domain": "{type: int, low: 1, high: 90, log: true}"},
        {"domain": "{type: choice, values: [a, b]}"},
        {"domain": "{type: bool}"},
        {"budget": "{batches: 4}"},
        {"budget": "[{batches: 4}, {time: 3600}]"},
        {"budget": "[]", "stopping": "[{no_improvement: 5}, {target_objective: 0.9}]"},
        {"variation": "ParameterVariationList: {name: force, values: ['${wind}']}"},
        {"extract": "failure_rate, params: {oracle: success}"},
        {"extract": "metrics, params: {time: {oracle: success, metric: time, aggregate: quantile, q: 0.9}}"},
    ],
)
def test_a_search_of_every_form_has_no_fault(said: Said, parts: dict[str, str]) -> None:
    assert said(**parts) == []


@pytest.mark.parametrize(
    ("parts", "why"),
    [
        ({"variation": "wind.py:Wind: {speed: $wind}"}, "9:5: search.variations[0].wind.py:Wind: its code raised SystemExit"),
        ({"extract": "wind.py:Wind"}, "10:21: search.extract.plugin: 'wind.py:Wind' is not executed by this version; failure_rate, or metrics"),
        ({"strategy": "./wind.py:Wind"}, "4:13: search.strategy: './wind.py:Wind' can't be imported"),
    ],
)  # fmt: skip
def test_a_plug_in_of_another_kind_leaves_the_file_valid_and_is_said(
    said: Said, parts: dict[str, str], why: str
) -> None:
    (found,) = said(**parts)
    assert why in found


@pytest.mark.parametrize(
    ("parts", "fault"),
    [
        ({"domain": "{type: float, low: 3, high: 1}"}, "6:5: search.search_space.gain: low 3 is greater than high 1; low <= high"),
        ({"domain": "{type: float, low: 3}"}, "6:5: search.search_space.gain: a range without both bounds; low and high"),
        ({"domain": "{type: float, low: 0, high: 1, log: true}"}, "low 0 on a logarithmic scale; low > 0"),
        ({"domain": "{type: float, low: 0, high: 1, step: 1}"}, "6:48: search.search_space.gain.step: 'step' has no meaning for type float; known: high, log, low"),
        ({"domain": "{type: int, low: 1, high: 9, log: true, step: 2}"}, "log and step are both given; one of them"),
        ({"domain": "{type: int, low: 0.5, high: 9}"}, "6:28: search.search_space.gain.low: found 0.5; a whole number, as type int has"),
        ({"domain": "{type: choice}"}, "a choice without values; values: [...]"),
        ({"domain": "{type: bool, values: [1]}"}, "'values' has no meaning for type bool; its type alone"),
        ({"domain": "{type: gaussian}"}, "6:18: search.search_space.gain.type: found 'gaussian'"),
        ({"domain": "{low: 0, high: 1}"}, "6:5: search.search_space.gain: no 'type'"),
        ({"budget": "[{}]"}, "found {}; one of batches, time, evaluations, runs, simulated_hours"),
        ({"budget": "[]"}, "3:1: search: neither budget nor stopping; at least one of them"),
        ({"budget": "[{batches: 0}]"}, "13:22: search.budget[0].batches: found 0; 1 or more"),
        ({"budget": "[{batch: 5}]"}, "search.budget[0]: unknown key 'batch'; did you mean 'batches'?"),
        ({"stopping": "[{metric: {name: coverage, op: '=>', value: 0.3}}]"}, "14:44: search.stopping[0].metric.op: found '=>'; did you mean '>'?"),
        ({"stopping": "[{no_improvement: 0}]"}, "found 0; 1 or more"),
        ({"variation": "ParameterVariationList: {name: force, values: [$wnd]}"}, "9:52: search.variations[0].ParameterVariationList.values[0]: found '$wnd', a dimension that search_space does not have; did you mean 'wind'?"),
        ({"variation": "ParameterVariationList: {name: force, values: [$wind], seeds: 1}"}, "unknown key 'seeds'"),
        ({"variation": "ParameterVariationLst: {name: force, values: [$wind]}"}, "did you mean 'ParameterVariationList'?"),
        ({"variation": "ParameterVariationList: {name: farce, values: [$wind]}"}, "3:1: search: scenario.osc needs force, which nothing writes"),
        ({"variation": "wind.py:Wnd: {}"}, "9:5: search.variations[0].wind.py:Wnd: no class 'Wnd' in wind.py; file.py:Class"),
        ({"strategy": "randm"}, "4:13: search.strategy: no strategy 'randm'; did you mean 'random'?"),
        ({"strategy": "qd"}, "3:1: search: no 'archive'"),
        ({"strategy": "boundary", "domain": "{type: bool}"}, "5:3: search.search_space: 'gain' is no range of numbers; ranges for boundary"),
        ({"extract": "failure"}, "10:21: search.extract.plugin: no plug-in 'failure'; did you mean 'failure_rate'?"),
        ({"extract": "metrics, params: {time: {metric: time}}"}, "metric without oracle; the oracle that measures it"),
        ({"stopping": "[{metric: {name: coverage, op: '>=', value: 0.3}}]"}, "14:30: search.stopping[0].metric.name: no metric of random 'coverage'; it reports none"),
        ({"budget": "[{runs: 20}]"}, "13:19: search.budget[0].runs: found 20, less than a batch of 8 points with 3 runs each; 24 or more"),
        ({"variation": "ParameterVariationList: {name: force, values: [$wind, 1]}"}, "9:5: search.variations[0].ParameterVariationList: ParameterVariationList makes several configurations of one point"),
        ({"extract": "gone.py:Extract"}, "10:21: search.extract.plugin: found 'gone.py:Extract', and there is no such file"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_search_is_one_fault_with_its_place(said: Said, parts: dict[str, str], fault: str) -> None:
    (found,) = said(**parts)
    assert fault in found


def test_a_criterion_that_is_a_number_is_short_for_its_main_field() -> None:
    spec = SearchSpec.model_validate(
        {
            "strategy": "random",
            "search_space": {"a": {"type": "bool"}},
            "budget": {"batches": 3},
            "stopping": [{"no_improvement": 5}],
        }
    )
    assert spec.budget == [Budget(batches=3)]
    assert spec.stopping[0].no_improvement == NoImprovement(patience=5)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("$a", "a"),
        ("${a b}", "a b"),
        ("${a{b}", "a{b"),
        ("$FollowPath.max_vel-x", "FollowPath.max_vel-x"),
        ("$$a", None),
        ("$a/x", None),
        ("a$b", None),
        ("@a", None),
        ("$1", None),
        (3, None),
    ],
)
def test_only_a_whole_text_is_a_marker(text: object, name: str | None) -> None:
    assert marker_of(text) == name
