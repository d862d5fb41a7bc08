"""The command `compare`: pairs, changes, the gate, JUnit and what can't be compared."""

import hashlib
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from table import each_row
from typer.main import get_command
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.flows.results.provenance import STAGES
from vastflow.oracles.results.schema import CONFIGURATIONS, REJECTIONS, RUNS, VERDICTS

INGREDIENTS = {
    "vastflow": "0.1.0",
    "numeric_class": "x86_64; glibc",
    "seed": 1,
    "oracles": [],
    "code": {stage: {"files": {"sim.run": "a"}, "libraries": {"numpy": "1.0"}} for stage in STAGES},
}
"""Of `metadata.json`: what the results follow from."""


def write(folder, configurations, *, oracles=("success",), seed="", created="2026-11-22T06:00:00", system_key="noise"):
    """A campaign directory without recordings.

    Args:
        configurations: Name to task, system, and a letter a run: p, f or n for not judged.
    """
    folder.mkdir(parents=True)
    rows, runs, verdicts = [], [], []
    for name, (task, system, said) in configurations.items():
        content = {"environment": {}, "task": {"goal": task}, "system": {system_key: system}}
        row = {
            "name": name,
            "family": "f",
            "scenario_digest": f"{task} {system}",
            "abstract": "builtin:navigate_to_pose",
        }
        rows.append(
            {**row, "scenario": json.dumps(content), "factors": json.dumps({"noise": system}), "provenance": "{}"}
        )
        for k, letter in enumerate(said):
            runs.append({"configuration": name, "run_index": k, "seed": f"{seed}{task}-{k}"})
            for oracle in oracles:
                judgement = {"p": "pass", "f": "fail", "n": "not judged"}[letter]
                verdict = {"configuration": name, "family": "f", "run_index": k, "oracle": oracle, "metrics": "{}"}
                verdicts.append({**verdict, "judgement": judgement, "reason": ""})
    tables = {"configurations": (rows, CONFIGURATIONS), "runs": (runs, RUNS)}
    tables |= {"verdicts": (verdicts, VERDICTS), "rejections": ([], REJECTIONS)}
    for table, (content, schema) in tables.items():
        pq.write_table(pa.Table.from_pylist(content, schema), folder / f"{table}.parquet")
    (folder / "campaign.vast").write_text("version: 1\n")
    (folder / "metadata.json").write_text(json.dumps({"name": folder.name, "created": created, **INGREDIENTS}))
    return folder


def same(said, system=0, configurations=12):
    """Configurations alike."""
    return {f"c{k}": (k, system, said) for k in range(configurations)}


def called(*arguments):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)], terminal_width=160)


def as_json(*arguments):
    result = called(*arguments, "--json")
    return json.loads(result.stdout)


@pytest.fixture
def before(tmp_path):
    return write(tmp_path / "before", same("p" * 10))


@pytest.fixture
def worse(tmp_path):
    return write(tmp_path / "worse", {**same("p" * 10, system=1), "c3": (3, 1, "f" * 10)})


def of_one_code(directory, **other):
    """The directory, as computed by some code."""
    metadata = json.loads((directory / "metadata.json").read_text())
    source = dict.fromkeys(("execute", "observe", "judge"), "5ca1ab1e")
    (directory / "metadata.json").write_text(json.dumps({**metadata, "source": source, **other}))
    return directory


def test_campaigns_that_end_alike_have_no_difference_and_hold_the_gate(before, tmp_path):
    result = called(before, write(tmp_path / "after", same("p" * 10)), "--gate", "--margin", 0.04)
    assert result.exit_code == 0, result.output
    assert "12 configurations paired (all equal), 120 pairs of runs" in result.stdout
    assert "gate holds: a loss of 4 points or more in these scenarios is ruled out" in result.stdout


def test_few_pairs_without_a_change_rule_out_no_loss_and_the_gate_says_how_many_do(before, tmp_path):
    # 0.98 to the power of 182 is above 0.025, of 183 below: a loss of 2 points shows none in 120 pairs in one of eleven cases.
    result = called(before, write(tmp_path / "after", same("p" * 10)), "--gate")
    assert result.exit_code == 1
    assert "gate does not hold: a loss of 2 points in these scenarios is not ruled out" in result.stdout
    assert "it takes 183 pairs without a change" in result.stdout


@pytest.mark.parametrize("target", ["these", "others"])
def test_campaign_of_equal_keys_passes_though_it_is_small(before, tmp_path, target):
    after = of_one_code(write(tmp_path / "elsewhere", same("p" * 10)))
    result = called(of_one_code(before), after, "--gate", "--target", target)
    assert result.exit_code == 0, result.output
    assert "gate holds: nothing changed" in result.stdout


@pytest.mark.parametrize(
    "other",
    [
        {"seed": 2},
        {"numeric_class": "aarch64; glibc"},
        {"oracles": [{"name": "success", "parameters": {}, "source": "execute"}]},
    ],
)
def test_other_code_seed_or_machine_may_have_changed_something(before, tmp_path, other):
    after = of_one_code(write(tmp_path / "elsewhere", same("p" * 10)), **other)
    assert as_json(of_one_code(before), after)["gate"]["status"] == "not ruled out"


def test_another_system_may_have_changed_something_though_the_code_is_the_same(before, tmp_path):
    after = of_one_code(write(tmp_path / "elsewhere", same("p" * 10, system=1)))
    assert as_json(of_one_code(before), after)["gate"]["status"] == "not ruled out"


def test_few_paths_cant_speak_of_others_and_the_exit_code_is_one_of_its_own(before, tmp_path):
    result = called(before, write(tmp_path / "after", same("p" * 10)), "--gate", "--target", "others")
    assert result.exit_code == 4
    assert "gate can't be claimed: 12 paths can't rule out a loss of 2 points in others of their kind" in result.stdout
    assert "it takes 183, even if nothing changes on any" in result.stdout


def test_few_paths_of_which_one_is_lost_do_not_hold_the_gate_for_others(before, worse):
    assert called(before, worse, "--gate", "--target", "others").exit_code == 1


def test_as_many_paths_as_the_margin_needs_speak_of_others(tmp_path):
    then, now = (write(tmp_path / name, same("pp", configurations=36)) for name in ("then", "now"))
    arguments = then, now, "--gate", "--target", "others", "--margin"
    assert called(*arguments, 0.1).exit_code == 0
    assert called(*arguments, 0.09).exit_code == 4


def test_no_number_of_paths_rules_out_every_loss(before, tmp_path):
    after = write(tmp_path / "after", same("p" * 10))
    result = called(before, after, "--gate", "--target", "others", "--margin", 0)
    assert result.exit_code == 4
    assert "no number of paths is enough" in result.stdout


def test_json_names_target_and_status_of_the_gate(before, worse):
    assert as_json(before, worse)["gate"] == {
        "target": "these",
        "status": "loss shown",
        "holds": False,
        "margin": 0.02,
        "paths": 12,
        "needed": 183,
        "new_faults": 0,
    }
    assert as_json(before, before, "--target", "others")["gate"]["status"] == "too few paths"


def test_campaigns_of_other_runs_never_hold_the_gate(tmp_path):
    then = write(tmp_path / "then", same("p" * 40))
    fewer = write(tmp_path / "fewer", same("p" * 40, configurations=11))
    shorter = write(tmp_path / "shorter", {**same("p" * 40), "c3": (3, 0, "p" * 39)})
    for a, b, why in (
        (then, fewer, "1 configuration only in A"),
        (fewer, then, "1 configuration only in B"),
        (then, shorter, "1 run of A with a seed that B has not"),
        (shorter, then, "1 run of B with a seed that A has not"),
    ):
        result = called(a, b, "--gate", "--margin", 0.5)
        assert result.exit_code == 1
        assert f"gate does not hold: {why}; it takes the same configurations and runs in both" in result.stdout


@each_row(("said", "held"), [("p" * 40, True), ("n" + "p" * 39, True), ("nn" + "p" * 38, False)])
def test_runs_that_can_no_longer_be_judged_may_be_as_many_as_may_be_lost(tmp_path, said, held):
    then, now = write(tmp_path / "then", same("p" * 40)), write(tmp_path / "now", same(said))
    assert as_json(then, now, "--margin", 0.03)["gate"]["holds"] == held


def test_campaigns_that_are_mostly_not_judged_never_hold_the_gate(tmp_path):
    then, now = (write(tmp_path / name, same("n" * 20 + "p" * 20)) for name in ("then", "now"))
    result = called(then, now, "--gate", "--margin", 0.5)
    assert result.exit_code == 1
    assert "gate does not hold: of 480 pairs, 240 were judged both times and 0 only in A" in result.stdout


def test_junit_file_has_target_and_status_and_what_cant_be_claimed_is_an_error(before, tmp_path):
    called(before, before, "--target", "others", "--junit", tmp_path / "compare.xml")
    gate, _ = ElementTree.parse(tmp_path / "compare.xml").getroot()
    (case,) = gate
    stated = {one.get("name"): one.get("value") for one in case.find("properties")}
    assert (stated["target"], stated["status"], stated["needed"]) == ("others", "too few paths", "183")
    assert case.find("error").get("message").startswith("gate can't be claimed: 12 paths")


def test_configuration_that_fails_newly_is_named_and_the_gate_does_not_hold(before, worse):
    result = called(before, worse, "--gate")
    assert result.exit_code == 1
    assert "12 configurations paired (12 of them with another system)" in result.stdout
    assert "newly failing: 1 configuration" in result.stdout
    assert "c3" in result.stdout and "10 of 10  0 of 10" in result.stdout
    assert "gate does not hold" in result.stdout


def test_shown_loss_is_called_shown(before, tmp_path):
    after = write(tmp_path / "after", same("pppppppfff"))
    result = called(before, after, "--gate")
    assert result.exit_code == 1
    assert re.search(
        r"a loss of 2\d\.\d to 3\d(\.\d)? points in these scenarios is shown, the margin is 2\n", result.stdout
    )


def test_differences_are_named_with_their_values_and_lines(before, worse):
    for folder, noise in ((before, 0), (worse, 1)):
        (folder / "campaign.vast").write_text(
            f"version: 1\nconfiguration:\n  - name: f\n    parameters:\n      - noise: {noise}\n"
        )
    other = {"files": {"sim.run": "b"}, "libraries": {"numpy": "2.0"}}
    said = called(before, of_one_code(worse, vastflow="0.2.0", code=dict.fromkeys(STAGES, other))).stdout
    assert "differs: noise: 0 (campaign.vast:5) → 1 (campaign.vast:5), 12 configurations" in said
    assert "differs: vastflow from '0.1.0' to '0.2.0'" in said
    assert "differs: source of execute changed: sim.run, numpy 1.0 is now 2.0" in said
    found = as_json(before, worse)["differs"][0]
    assert found == {
        "parameter": "noise",
        "before": {"value": "0", "place": "campaign.vast:5"},
        "after": {"value": "1", "place": "campaign.vast:5"},
        "configurations": 12,
    }
    assert "differs: no parameter, version, or code" in called(before, before).stdout


def test_differences_of_nav2_files_are_those_of_their_parameters(tmp_path):
    folders = []
    for name, speed in (("then", 0.5), ("now", 0.3)):
        text = f"controller_server:\n  ros__parameters:\n    FollowPath:\n      vx_max: {speed}\n"
        digest = hashlib.sha256(text.encode()).hexdigest()
        folders.append(write(tmp_path / name, same("pp", system={"file": digest}), system_key="nav2_params"))
        (folders[-1] / "inputs").mkdir()
        (folders[-1] / "inputs" / "nav2.yaml").write_text(text)
    place = "controller_server.ros__parameters.FollowPath.vx_max"
    words = f"differs: {place}: 0.5 (inputs/nav2.yaml:4) → 0.3 (inputs/nav2.yaml:4), 12 configurations"
    said = called(*folders).stdout
    assert words in said and "nav2_params" not in said


def test_without_gate_the_exit_code_says_nothing_of_the_result(before, worse):
    assert called(before, worse).exit_code == 0


def test_margin_that_is_wide_enough_lets_the_gate_hold(before, worse):
    assert called(before, worse, "--gate", "--margin", 0.5).exit_code == 0


def faulty(directory, *names):
    """The directory with a fault of the first run of each of these configurations."""
    metadata = json.loads((directory / "metadata.json").read_text())
    faults = [{"configuration": name, "run_index": 0, "stage": "execute", "error": "no goal"} for name in names]
    (directory / "metadata.json").write_text(json.dumps({**metadata, "faults": faults}))
    return directory


def test_change_by_which_runs_can_no_longer_be_judged_does_not_hold_the_gate(before, tmp_path):
    after = faulty(write(tmp_path / "after", same("p" * 10)), "c1", "c2")
    result = called(before, after, "--gate")
    assert result.exit_code == 1
    assert "gate does not hold: 2 new faults in B, whose runs could not be judged" in result.stdout


def test_faults_that_were_there_before_do_not_count_against_a_change(tmp_path):
    then, now = (faulty(write(tmp_path / name, same("p" * 10)), "c1") for name in ("then", "now"))
    assert called(then, now, "--gate", "--margin", 0.04).exit_code == 0


def test_what_passes_newly_is_shown_as_such(before, worse):
    assert "newly passing: 1 configuration" in called(worse, before).stdout
    found = as_json(worse, before)
    assert [(one["configuration"], one["shown"], one["worse"]) for one in found["changes"]] == [("c3", True, False)]


def test_json_has_the_numbers_of_the_table(before, worse):
    found = as_json(before, worse)
    assert list(found["paired"].values()) == [12, 0, 12, 120, 120]
    assert list(found["paired"]) == ["configurations", "equal", "other_system", "runs", "judged_both_times"]
    assert found["difference"]["difference"] == pytest.approx(-10 / 120)
    assert (found["difference"]["lost"], found["difference"]["gained"]) == (10, 0)
    assert found["oracles"]["success"]["lost"] == 10


def test_each_level_of_a_factor_has_its_row(tmp_path):
    systems = {f"c{k}-{s}": (k, s, "p" * 8) for k in range(6) for s in (0, 1)}
    lost = {name: (k, s, "f" * 8 if s else "p" * 8) for name, (k, s, _) in systems.items()}
    found = as_json(write(tmp_path / "a", systems), write(tmp_path / "b", lost))
    levels = {one["level"]: one["difference"] for one in found["levels"]}
    assert levels == {"0": 0.0, "1": -1.0}


def test_runs_that_were_not_judged_both_times_are_counted_and_in_no_rate(before, tmp_path):
    found = as_json(before, write(tmp_path / "after", same("pppnnppppf")))
    assert (found["paired"]["runs"], found["paired"]["judged_both_times"]) == (120, 96)
    assert found["difference"]["lost"] == 12


def test_configurations_and_runs_without_a_counterpart_are_counted_and_listed(tmp_path):
    before = write(tmp_path / "a", {"old": (90, 0, "pp"), "both": (1, 0, "pppp")})
    after = write(tmp_path / "b", {"both": (1, 1, "pp"), "new": (91, 0, "pp")})
    result = called(before, after)
    assert "not paired: 1 configuration only in A: old" in result.stdout
    assert "not paired: 1 configuration only in B: new" in result.stdout
    assert "not paired: 2 runs of A with a seed that the other has not" in result.stdout


def test_renamed_configuration_is_paired_by_its_content(tmp_path):
    before = write(tmp_path / "a", {"old": (1, 0, "pppp"), "same": (2, 0, "pppp")})
    after = write(tmp_path / "b", {"new": (1, 7, "ffff"), "same": (2, 0, "pppp")})
    found = as_json(before, after)
    assert [(one["configuration"], one["was"]) for one in found["changes"]] == [("new", "old")]


def test_several_systems_on_one_task_are_paired_by_name_or_not_at_all(tmp_path):
    before = write(tmp_path / "a", {"slow": (1, 1, "pp"), "fast": (1, 2, "pp"), "third": (1, 3, "pp")})
    after = write(tmp_path / "b", {"slow": (1, 4, "pp"), "quick": (1, 5, "pp"), "fourth": (1, 6, "pp")})
    found = as_json(before, after)
    assert found["paired"]["configurations"] == 1
    assert found["unpaired"]["ambiguous"] == ["quick", "fourth"]
    assert found["unpaired"]["only_before"] == ["fast", "third"]


def test_only_the_oracles_that_judged_both_count(tmp_path):
    before = write(tmp_path / "a", same("pp"), oracles=("success",))
    after = write(tmp_path / "b", same("pp"), oracles=("success", "safety"))
    assert list(as_json(before, after)["oracles"]) == ["success"]


def test_one_oracle_can_be_compared_alone(tmp_path):
    before = write(tmp_path / "a", same("pp"), oracles=("success", "safety"))
    assert as_json(before, before, "--oracle", "safety")["oracle"] == "safety"


def test_oracle_that_is_not_there_is_answered_with_the_nearest(before):
    result = called(before, before, "--oracle", "sucess")
    assert result.exit_code == 2
    assert "--oracle sucess: did not judge both campaigns; did you mean 'success'?" in result.stderr


def test_campaigns_without_a_common_configuration_are_bad_input(before, tmp_path):
    result = called(before, write(tmp_path / "other", {"x": (99, 0, "pp")}), "--gate")
    assert result.exit_code == 2
    assert "nothing to compare: no configuration of one has the environment" in result.stderr


def test_other_seeds_are_bad_input_that_names_the_key(before, tmp_path):
    result = called(before, write(tmp_path / "other", same("p" * 10), seed="7-"))
    assert result.exit_code == 2
    assert "none of their runs have a seed in common; `execution.seed` must be the same" in result.stderr


def test_what_is_no_campaign_directory_is_bad_input(before, tmp_path):
    result = called(before, tmp_path / "nowhere")
    assert result.exit_code == 2
    assert "no such folder" in result.stderr


def test_damaged_directory_is_bad_input(before, worse):
    (worse / "verdicts.parquet").write_bytes(b"")
    result = called(before, worse)
    assert result.exit_code == 2
    assert "damaged campaign directory" in result.stderr


def test_junit_file_has_the_gate_and_every_configuration(before, worse, tmp_path):
    called(before, worse, "--junit", tmp_path / "compare.xml")
    gate, configurations = ElementTree.parse(tmp_path / "compare.xml").getroot()
    assert (gate.get("name"), gate.get("failures")) == ("gate", "1")
    assert (configurations.get("tests"), configurations.get("failures")) == ("12", "1")
    (failed,) = [case for case in configurations if case.find("failure") is not None]
    assert failed.get("name") == "c3"
    assert failed.find("failure").get("message") == "newly failing: 10 of 10 before, 0 after"


def test_junit_file_that_cant_be_written_is_bad_input(before, worse, tmp_path):
    result = called(before, worse, "--junit", tmp_path / "no" / "compare.xml")
    assert result.exit_code == 2
    assert "can't be written" in result.stderr


def test_configuration_without_a_map_is_named_and_not_drawn(before, worse):
    result = called(before, worse)
    assert "not drawn: c3: it has no map" in result.stderr
    assert not (worse / "comparisons").exists()


def test_options_are_all_described():
    page = (Path(__file__).parents[2] / "docs" / "compare-campaigns.md").read_text()
    described = set(re.findall(r"^\| `(--[a-z]+)", page, re.MULTILINE))
    command = get_command(app).commands["compare"]
    assert described == {name for option in command.params for name in option.opts if name.startswith("--")}
