"""The search section: right forms, faults with their places, and plug-ins that can't be run here."""

from collections.abc import Callable
from pathlib import Path

import pytest
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.campaign_file.search import marker_of
from vastflow.sim.model.faults import FileError

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
    """The faults of a search with some parts replaced, or why it can't be run."""

    def faults(**parts: str) -> list[str]:
        (tmp_path / "scenario.osc").write_text(SCENARIO)
        (tmp_path / "wind.py").write_text("raise SystemExit('nothing of a plug-in runs here')\nclass Wind: ...\n")
        file = tmp_path / "c.vast"
        file.write_text(FILE.format(**{**GOOD, **parts}))
        try:
            found = list(load_campaign(file).unexecutable)
        except FileError as error:
            found = list(error.faults)
        return [str(fault).removeprefix(f"{file}:") for fault in found]

    return faults


@each_row(
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
def test_search_of_every_form_has_no_fault(said: Said, parts: dict[str, str]) -> None:
    assert said(**parts) == []


@each_row(
    ("parts", "why"),
    [
        ({"variation": "wind.py:Wind: {speed: $wind}"}, "9:5: search.variations[0].wind.py:Wind: 'wind.py:Wind' can't be imported: PlugInExit: its code raised SystemExit"),
        ({"extract": "wind.py:Wind"}, "10:21: search.extract.plugin: 'wind.py:Wind' is not executed by this version. Use failure_rate, or metrics"),
        ({"strategy": "./wind.py:Wind"}, "4:13: search.strategy: './wind.py:Wind' can't be imported"),
    ],
)  # fmt: skip
def test_unmodeled_plug_in_is_noted_and_file_stays_valid(said: Said, parts: dict[str, str], why: str) -> None:
    (found,) = said(**parts)
    assert why in found


def test_faults_of_a_search_have_place_and_message(golden, said: Said) -> None:
    """An input has the replaced parts, one a line."""
    golden("campaign_files", "search", lambda parts: said(**dict(line.split(": ", 1) for line in parts.splitlines())))


MARKERS = {"$a": "a", "${a b}": "a b", "${a{b}": "a{b", "$FollowPath.max_vel-x": "FollowPath.max_vel-x"}


@each_row(("text", "name"), [*MARKERS.items(), *((text, None) for text in ("$$a", "$a/x", "a$b", "@a", "$1", 3))])
def test_marker_is_a_whole_text(text: object, name: str | None) -> None:
    assert marker_of(text) == name
