"""`compare --until-decided`: rounds of two campaigns, their end, and the text on it."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from command_line import called, refused
from judged_directory import STAGES, same, write
from table import each_row

from vastflow.flows.analysis.until_decided import Side, compared_until_decided
from vastflow.flows.request.run_request import request_of
from vastflow.sim.model.faults import UserError


@pytest.fixture
def decided(small_room, tmp_path):
    """Give the comparison of two campaigns whose runs end as in these tables, of which each round has the first."""
    calls = []

    def compare(before, after, runs=10, **options):
        results = [tmp_path / "A", tmp_path / "B"]
        sides = [Side(request_of(small_room, {"runs": runs, "results": each})) for each in results]
        planned = [before, after]

        def run(request):
            table = planned[request.results.endswith("B")]
            calls.append(request.runs)
            rows = {name: (task, system, said[: request.runs]) for name, (task, system, said) in table.items()}
            metadata = write(tmp_path / f"{len(calls)}", rows) / "metadata.json"
            metadata.write_text(
                json.dumps({**json.loads(metadata.read_text()), "source": dict.fromkeys(STAGES, "5ca1ab1e")})
            )
            return SimpleNamespace(directory=metadata.parent)

        found, decision = compared_until_decided(*sides, run, **options)
        return found, decision, calls

    return compare


PASSED, FAILED = "p" * 10, "f" * 10


def mixed(good, bad, system=1):
    said = [PASSED] * good + [FAILED] * bad
    return {f"c{k}": (k, system, each) for k, each in enumerate(said)}


@each_row(
    ("then", "now", "options", "shown", "rounds"),
    [
        (mixed(40, 0, 0), mixed(40, 0), {}, ("loss ruled out",), 6),  # 227 seeds in rounds of 40
        (mixed(40, 0, 0), mixed(40, 0), {"runs": 5}, (), 5),
        (mixed(9, 3), mixed(9, 3), {}, ("nothing changed",), 1),
        (mixed(40, 0, 0), mixed(20, 20), {}, ("lost the margin", "worse"), 1),
        (mixed(20, 20, 0), mixed(40, 0), {}, ("better", "loss ruled out"), 1),
        (mixed(38, 2, 0), mixed(40, 0), {"margin": 0.0, "runs": 6}, ("better", "loss ruled out"), 4),
        (mixed(40, 0, 0), mixed(40, 0), {"margin": 0.0, "runs": 4}, (), 4),
    ],
)
def test_rounds_end_with_the_first_claim(decided, then, now, options, shown, rounds):
    found, decision, _ = decided(then, now, **options)
    assert (decision.shown, decision.rounds) == (shown, rounds)
    assert (decision.runs, decision.planned) == (2 * len(now) * rounds, 2 * len(now) * options.get("runs", 10))
    assert found.gate.exit_code == (4 if not shown else 1 if "worse" in shown else 0)


def test_round_adds_one_run_and_the_last_goes_to_the_results(decided):
    _, decision, calls = decided(mixed(40, 0, 0), mixed(40, 0), margin=0.04)
    assert decision.rounds == 3
    assert calls == [1, 1, 2, 2, 3, 3, 3, 3]


def test_comparison_calls_no_configuration_newly_failing(decided):
    found, decision, _ = decided(mixed(12, 0, 0), mixed(11, 1), runs=6, margin=0.01)
    assert (decision.shown, found.changes[0].lost, found.shown(worse=True)) == ((), 6, [])


def test_pairs_not_judged_and_unpaired_configurations_decide_nothing(decided):
    then = {**mixed(12, 0, 0), **{f"n{k}": (100 + k, 0, PASSED) for k in range(40)}, "gone": (999, 0, PASSED)}
    now = {**mixed(12, 0), **{f"n{k}": (100 + k, 1, "n" * 10) for k in range(40)}}
    found, decision, _ = decided(then, now, runs=3)
    assert (decision.shown, found.whole.pairs) == ((), 36)
    assert decision.runs == 3 * (53 + 52)
    assert (found.gate.status, found.gate.exit_code) == ("unequal", 1)


def test_settings_on_one_path_decide_no_earlier_than_one_alone(decided):
    alone = decided({"c": (0, 0, PASSED)}, {"c": (0, 1, FAILED)}, runs=10)[1]
    settings = [{f"c{k}": (0, k, said) for k in range(4)} for said in (PASSED, FAILED)]
    assert decided(*settings, runs=10)[1].rounds == alone.rounds == 7


def test_side_refuses_a_search():
    search = next((Path(__file__).parents[2] / "campaigns" / "search").glob("*.vast"))
    with pytest.raises(UserError, match="got a search, whose results choose them"):
        Side(request_of(search, {})).rounds()


def test_command_refuses_other_targets_and_options_of_runs_alone(tmp_path):
    before = write(tmp_path / "before", same("p"))
    words = refused("compare", before, before, "--until-decided", "--target", "others")
    assert words == "--until-decided: expected --target these, got others. More runs of a path make no other paths."
    assert refused("compare", before, before, "--runs", 3) == "--runs: requires --until-decided, which runs campaigns"


def test_command_prints_reason_for_last_round(small_room, tmp_path, monkeypatch):
    def run_campaign(request, *, observer):
        runs = PASSED[: request.runs]
        return SimpleNamespace(directory=write(tmp_path / f"{len(list(tmp_path.iterdir()))}", same(runs, 0, 24)))

    monkeypatch.setattr("vastflow.flows.api.run_campaign", run_campaign)
    arguments = ("compare", small_room, small_room, "--until-decided", "--margin", 0.1, "--runs", 9)
    result = called(*arguments, "--gate")
    assert result.exit_code == 0, result.output
    assert (
        "decided after 2 of 9 rounds: a loss of 10 points or more is ruled out; 96 runs of A and B, 432 in all rounds"
        in result.stdout
    )
    assert "round 2 of 9: B +0.0 points, 95 % -9.1 to +9.1" in result.stderr
    said = json.loads(called(*arguments, "--json").stdout)
    assert said["until_decided"] == {
        "shown": ["loss ruled out"],
        "rounds": 2,
        "most": 9,
        "runs": 96,
        "planned": 432,
        "margin": 0.1,
    }
    undecided = called("compare", small_room, small_room, "--until-decided", "--runs", 9, "--gate")
    assert (undecided.exit_code, "undecided after 9 of 9 rounds" in undecided.stdout) == (4, True)
