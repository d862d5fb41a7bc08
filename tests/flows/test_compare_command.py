"""The command `compare`: pairs, changes, the gate, and JUnit."""

import hashlib
import json
from dataclasses import replace
from itertools import product
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import called, refused
from judged_directory import same, write
from table import each_row
from typer.testing import CliRunner

from vastflow.flows.cli.__main__ import app
from vastflow.flows.results.provenance import STAGES
from vastflow.oracles.results.schema import RUNS
from vastflow.sim.model.nodes import NodeProcess, Nodes
from vastflow.sim.model.scenario import ProcessSetup


def compared(*arguments):
    return called("compare", *arguments)


def as_json(*arguments):
    return json.loads(compared(*arguments, "--json").stdout)


@pytest.fixture
def before(tmp_path):
    return write(tmp_path / "before", same("p" * 10))


@pytest.fixture
def worse(tmp_path):
    return write(tmp_path / "worse", {**same("p" * 10, system=1), "c3": (3, 1, "f" * 10)})


def noted(directory, **content):
    """The directory with this content of `metadata.json`."""
    metadata = json.loads((directory / "metadata.json").read_text())
    (directory / "metadata.json").write_text(json.dumps({**metadata, **content}))
    return directory


def of_one_code(directory, **other):
    """The directory, as computed by some code."""
    return noted(directory, source=dict.fromkeys(("execute", "observe", "judge"), "5ca1ab1e"), **other)


def faulty(directory, *names):
    """The directory with a fault of the first run of each of these configurations."""
    fault = {"run_index": 0, "stage": "execute", "error": "no goal"}
    return noted(directory, faults=[{**fault, "configuration": name} for name in names])


ALIKE = same("p" * 10)
LONG = same("p" * 40)
FEWER = same("p" * 40, configurations=11)
SHORTER = {**LONG, "c3": (3, 0, "p" * 39)}
STOPPED = {**LONG, "c3": (3, 0, "p" * 9), "c5": (5, 0, "f" * 12)}
HALF = same("n" * 20 + "p" * 20)
PATHS = same("pp", configurations=36)
WIDE = ("--margin", 0.5)
OTHERS = ("--target", "others")
GATES = [
    (ALIKE, ALIKE, (), 1, "gate does not hold: a loss of 2 points in these scenarios is not ruled out"),
    # 0.98 to the power of 182 is above 0.025, of 183 below: a loss of 2 points shows none in 120 pairs in one of eleven cases.
    (ALIKE, ALIKE, (), 1, "it takes 183 pairs without a change"),
    (ALIKE, ALIKE, ("--margin", 0.04), 0, "gate holds: a loss of 4 points or more in these scenarios is ruled out"),
    (
        ALIKE,
        ALIKE,
        OTHERS,
        4,
        "can't be claimed: 12 situations can't rule out a loss of 2 points in other situations, it takes 183",
    ),
    (ALIKE, ALIKE, (*OTHERS, "--margin", 0), 4, "no number of situations is enough"),
    (PATHS, PATHS, (*OTHERS, "--margin", 0.1), 0, "gate holds"),
    (PATHS, PATHS, (*OTHERS, "--margin", 0.09), 4, "gate can't be claimed"),
    (LONG, FEWER, WIDE, 1, "could not pair 1 configuration only in A (run a baseline with B's configurations)"),
    (FEWER, LONG, WIDE, 0, "gate holds"),
    (LONG, SHORTER, (), 0, "gate holds"),
    (SHORTER, LONG, (), 0, "gate holds"),
    (STOPPED, {**STOPPED, "c3": (3, 1, "p" * 40), "c4": (4, 1, "p" * 9)}, (), 0, "gate holds"),
    (LONG, same("n" + "p" * 39), ("--margin", 0.03), 0, "gate holds"),
    (LONG, same("nn" + "p" * 38), ("--margin", 0.03), 1, "judged both times and 24 only in A"),
    (HALF, HALF, WIDE, 1, "gate does not hold: of 480 pairs, 240 were judged both times and 0 only in A"),
    (ALIKE, same("pppppppfff"), (), 1, " points in these scenarios is shown, the margin is 2\n"),
]


@each_row(("then", "now", "options", "exit_code", "words"), GATES)
def test_gate_exits_with_own_code_and_reason(tmp_path, then, now, options, exit_code, words):
    result = compared(write(tmp_path / "then", then), write(tmp_path / "now", now), "--gate", *options)
    assert (result.exit_code, words in result.stdout) == (exit_code, True), result.output


def test_gate_refuses_runs_with_other_seeds_and_suggests_remedy(tmp_path):
    before, after = write(tmp_path / "a", LONG), write(tmp_path / "b", LONG)
    runs = pq.read_table(after / "runs.parquet").to_pylist()
    for run in runs[2:5]:
        run["seed"] += "x"
    pq.write_table(pa.Table.from_pylist(runs, RUNS), after / "runs.parquet")
    result = compared(before, after, "--gate", *WIDE)
    assert result.exit_code == 1
    assert "could not pair 6 runs with other seeds (give both campaigns one `execution.seed`)" in " ".join(
        result.stdout.split()
    )


@each_row(
    ("differ", "words"),
    [
        ("map", "12 maps can't rule out a loss of 2 points in other maps with this path, it takes 183"),
        ("goal on a map", "12 paths can't rule out a loss of 2 points in other paths on this map, it takes 183"),
    ],
)
def test_gate_names_the_units_that_it_speaks_of(tmp_path, differ, words):
    then, now = (write(tmp_path / name, ALIKE, differ=differ) for name in ("then", "now"))
    assert words in compared(then, now, "--gate", *OTHERS).stdout


@each_row(
    ("system", "other", "status"),
    [
        (0, {}, "nothing changed"),
        (0, {"seed": 2}, "not ruled out"),
        (0, {"numeric_class": "aarch64; glibc"}, "not ruled out"),
        (0, {"oracles": [{"name": "success", "parameters": {}, "source": "execute"}]}, "not ruled out"),
        (1, {}, "not ruled out"),
    ],
)
def test_gate_calls_campaigns_of_equal_keys_unchanged(tmp_path, system, other, status):
    before = of_one_code(write(tmp_path / "before", ALIKE))
    after = of_one_code(write(tmp_path / "after", same("p" * 10, system=system)), **other)
    assert as_json(before, after)["gate"]["status"] == status
    if status == "nothing changed":
        for target in ("these", "others"):
            result = compared(before, after, "--gate", "--target", target)
            assert (result.exit_code, "gate holds: nothing changed" in result.stdout) == (0, True)


def test_gate_fails_only_for_new_faults(tmp_path, before):
    after = faulty(write(tmp_path / "after", ALIKE), "c1", "c2")
    result = compared(before, after, "--gate")
    assert result.exit_code == 1
    assert "gate does not hold: 2 new faults in B, whose runs could not be judged" in result.stdout
    assert compared(faulty(before, "c1", "c2"), after, "--gate", "--margin", 0.04).exit_code == 0


def test_compare_names_newly_failing_configuration_and_gate_fails(before, worse):
    result = compared(before, worse, "--gate")
    assert result.exit_code == 1
    for words in (
        "12 configurations paired (12 of them with another system)",
        "newly failing: 1 configuration",
        "10 of 10  0 of 10",
        "gate does not hold",
    ):
        assert words in result.stdout
    assert "not drawn: c3: it has no map" in result.stderr and not (worse / "comparisons").exists()
    for options, exit_code in (((), 0), (("--gate", *WIDE), 0), (("--gate", *OTHERS), 1)):
        assert compared(before, worse, *options).exit_code == exit_code
    assert "newly passing: 1 configuration" in compared(worse, before).stdout
    (change,) = as_json(worse, before)["changes"]
    assert (change["configuration"], change["shown"], change["worse"]) == ("c3", True, False)


def test_compare_prints_json_of_pairs_differences_and_gate(before, worse):
    found = as_json(before, worse)
    gate = {"target": "these", "status": "loss shown", "holds": False, "margin": 0.02}
    assert found["gate"] == {**gate, "paths": 12, "needed": 183, "new_faults": 0}
    paired = {"configurations": 12, "equal": 0, "other_system": 12}
    assert found["paired"] == {**paired, "runs": 120, "judged_both_times": 120}
    assert found["difference"]["difference"] == pytest.approx(-10 / 120)
    assert (found["difference"]["lost"], found["difference"]["gained"]) == (10, 0)
    assert found["oracles"]["success"]["lost"] == 10


def test_compare_names_differences_with_values_and_lines(before, worse):
    for folder, noise in ((before, 0), (worse, 1)):
        (folder / "campaign.vast").write_text(
            f"version: 1\nconfiguration:\n  - name: f\n    parameters:\n      - noise: {noise}\n"
        )
    other = {"files": {"sim.run": "b"}, "libraries": {"numpy": "2.0"}}
    said = compared(before, of_one_code(worse, vastflow="0.2.0", code=dict.fromkeys(STAGES, other))).stdout
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
    assert "differs: no parameter, version, or code" in compared(before, before).stdout


def test_compare_names_parameters_that_differ_between_nav2_files(tmp_path):
    folders = []
    for name, speed in (("then", 0.5), ("now", 0.3)):
        text = f"controller_server:\n  ros__parameters:\n    FollowPath:\n      vx_max: {speed}\n"
        digest = hashlib.sha256(text.encode()).hexdigest()
        folders.append(write(tmp_path / name, same("pp", system={"file": digest}), system_key="nav2_params"))
        (folders[-1] / "inputs").mkdir()
        (folders[-1] / "inputs" / "nav2.yaml").write_text(text)
    place = "controller_server.ros__parameters.FollowPath.vx_max"
    words = f"differs: {place}: 0.5 (inputs/nav2.yaml:4) → 0.3 (inputs/nav2.yaml:4), 12 configurations"
    said = compared(*folders).stdout
    assert words in said and "nav2_params" not in said


SYSTEMS = {f"c{k}-{s}": (k, s, "p" * 8) for k in range(6) for s in (0, 1)}
LOST = {name: (k, s, "f" * 8 if s else "p" * 8) for name, (k, s, _) in SYSTEMS.items()}


@each_row(
    ("then", "now", "expected"),
    [
        (SYSTEMS, LOST, {"levels.0.level": "0", "levels.0.difference": 0.0, "levels.1.difference": -1.0}),
        (ALIKE, same("pppnnppppf"), {"paired.runs": 120, "paired.judged_both_times": 96, "difference.lost": 12}),
        (
            {"old": (1, 0, "pppp"), "same": (2, 0, "pppp")},
            {"new": (1, 7, "ffff"), "same": (2, 0, "pppp")},
            {"changes.0.configuration": "new", "changes.0.was": "old"},
        ),
        (
            {"slow": (1, 1, "pp"), "fast": (1, 2, "pp"), "third": (1, 3, "pp")},
            {"slow": (1, 4, "pp"), "quick": (1, 5, "pp"), "fourth": (1, 6, "pp")},
            {
                "paired.configurations": 1,
                "unpaired.ambiguous": ["quick", "fourth"],
                "unpaired.only_before": ["fast", "third"],
            },
        ),
        (
            {"old": (90, 0, "pp"), "both": (1, 0, "pppp")},
            {"both": (1, 1, "pp"), "new": (91, 0, "pp")},
            {"unpaired.only_before": ["old"], "unpaired.only_after": ["new"], "unpaired.runs_before": 2},
        ),
    ],
)
def test_compare_pairs_configurations_by_name_or_content_and_runs_by_seed(tmp_path, then, now, expected):
    found = as_json(write(tmp_path / "then", then), write(tmp_path / "now", now))
    for path, value in expected.items():
        part = found
        for key in path.split("."):
            part = part[int(key) if key.isdigit() else key]
        assert part == value, path


THREE = {
    f"c{path}-{noise}{drop}{clutter}": (path, {"noise": noise, "drop": drop, "clutter": clutter}, "ppp")
    for path, noise, drop, clutter in product(range(8), (0, 1), (0, 1), (0, 1))
}


def times(seed, planted):
    """Return times (s) by configuration and run, longer by what `planted` says for noise, dropout, and clutter."""
    rng = np.random.default_rng(seed)

    def time_s(name, _):
        return 10.0 + int(name[1]) + rng.normal(0.0, 0.5) + planted(*map(int, name[3:]))

    return time_s


def test_compare_attributes_a_difference_to_the_factor_that_it_was_planted_by(tmp_path):
    before = write(tmp_path / "a", THREE, system_key=None, time_s=times(1, lambda noise, drop, clutter: 3.0 * clutter))
    after = {name: (*rest, "fff" if name.endswith("1") else "ppp") for name, (*rest, _) in THREE.items()}
    slow = times(2, lambda noise, drop, clutter: 3.0 * clutter + 4.0 * noise)
    found = as_json(before, write(tmp_path / "b", after, system_key=None, time_s=slow))
    (time,) = found["metrics"]
    assert (time["metric"], time["pairs"], time["equal"]) == ("time", 96, 0)  # the others failed in B
    assert time["interval"][0] < time["difference"] == pytest.approx(2.0, abs=0.3) and time["adjusted"] < 1e-3
    assert time["most"][3] == "1" and time["most_difference"] == pytest.approx(4.0, abs=1.0)
    explained = [
        (one["name"], one["metric"], one["these"]["shown"], one["others"]["shown"]) for one in found["explained"]
    ]
    assert sorted(explained) == [("clutter", "passing", True, True), ("noise", "time", True, True)]
    means = {one["name"]: one["means"] for one in found["explained"]}
    assert means["clutter"] == [0.0, -1.0] and means["noise"] == pytest.approx([0.0, 4.0], abs=0.3)
    text = compared(before, tmp_path / "b", "--target", "others").stdout
    assert "where both reached the goal  pairs  equal" in text and "95 %, others" in text
    assert "clutter  passing                    0: +0, 1: -1" in text


def test_compare_explains_nothing_where_nothing_was_planted(tmp_path):
    before, after = (write(tmp_path / str(k), THREE, system_key=None, time_s=times(k, lambda *_: 0.0)) for k in (3, 4))
    found = as_json(before, after)
    assert found["explained"] == [] and found["metrics"][0]["adjusted"] > 0.05
    alike = as_json(before, before)["metrics"][0]
    assert (alike["equal"], alike["difference"], alike["interval"], alike["adjusted"]) == (192, 0.0, [0.0, 0.0], 1.0)
    assert "192 pairs of runs, 192 of them with the same verdict" in compared(before, before).stdout


def test_compare_takes_each_path_once_for_others(tmp_path):
    some = {f"c{k}": (k, 0, "pppp") for k in range(2)}
    times_s = {"c0": [1.0, 1.0, 1.0, 1.0], "c1": [5.0, 5.0, 5.0, 5.0]}
    before = write(tmp_path / "a", some, time_s=lambda name, k: 1.0)
    after = write(tmp_path / "b", {**some, "c0": (0, 0, "pfff")}, time_s=lambda name, k: times_s[name][k])
    means = {target: as_json(before, after, "--target", target)["metrics"][0] for target in ("these", "others")}
    assert (means["these"]["after"], means["others"]["after"]) == (pytest.approx(4.2), 3.0)
    assert means["others"]["interval"] == pytest.approx([2.0 - 12.706 * 2.0, 2.0 + 12.706 * 2.0], rel=1e-3)


def test_compare_names_the_nodes_that_drive_one_of_two_campaigns(tmp_path):
    nodes = Nodes((NodeProcess("follower", ("python3", "follower.py")),))
    driven = write(tmp_path / "b", ALIKE, programs=ProcessSetup(nodes=nodes).content)
    text = compared(write(tmp_path / "a", ALIKE), driven).stdout
    assert "differs: driver: the built-in stack → follower; in lock step, 12 configurations" in text
    assert "programs." not in text
    paced = ProcessSetup(nodes=replace(nodes, time="paced")).content
    text = compared(driven, write(tmp_path / "c", ALIKE, programs=paced)).stdout
    assert "differs: programs.nodes.time: lock_step → paced, 12 configurations" in text


def test_compare_counts_common_oracles_or_a_selected_one(tmp_path):
    before = write(tmp_path / "a", same("pp"), oracles=("success",))
    after = write(tmp_path / "b", same("pp"), oracles=("success", "safety"))
    assert list(as_json(before, after)["oracles"]) == ["success"]
    assert as_json(after, after, "--oracle", "safety")["oracle"] == "safety"


@each_row(
    ("other", "parts", "options", "words"),
    [
        (
            ALIKE,
            {},
            ("--oracle", "sucess"),
            "--oracle: No oracle 'sucess' judged both campaigns. Did you mean 'success'?",
        ),
        ({"x": (99, 0, "pp")}, {}, (), "nothing to compare: no configuration of one has the environment"),
        (
            {"c0-1": (0, 1, "pp"), "c0-2": (0, 2, "pp")},
            {},
            (),
            "nothing to compare: 2 configurations of B, such as c0-1, have several counterparts in A or share one",
        ),
        (
            ALIKE,
            {"seed": "7-"},
            (),
            "common configurations have no common seed. Give both campaigns the same `execution.seed`",
        ),
        (ALIKE, {"oracles": ("safety",)}, (), "no oracle judged both"),
        (same("n" * 10), {}, (), "no run of 120 pairs was judged both times"),
        (ALIKE, {}, ("--junit", "no/compare.xml"), "can't be written"),
    ],
)
def test_compare_refuses_campaigns_with_nothing_in_common(tmp_path, other, parts, options, words):
    campaigns = write(tmp_path / "before", ALIKE), write(tmp_path / "after", other, **parts)
    assert words in refused("compare", *campaigns, "--gate", *options)


def test_compare_writes_junit_file_with_gate_and_every_configuration(before, worse, tmp_path):
    compared(before, worse, "--junit", tmp_path / "compare.xml")
    gate, configurations = ElementTree.parse(tmp_path / "compare.xml").getroot()
    assert (gate.get("name"), gate.get("failures")) == ("gate", "1")
    assert (configurations.get("tests"), configurations.get("failures")) == ("12", "1")
    (failed,) = [case for case in configurations if case.find("failure") is not None]
    assert failed.get("name") == "c3"
    assert failed.find("failure").get("message") == "newly failing: 10 of 10 before, 0 after"
    compared(before, write(tmp_path / "after", ALIKE), *OTHERS, "--junit", tmp_path / "compare.xml")
    ((case,), _) = ElementTree.parse(tmp_path / "compare.xml").getroot()
    stated = {one.get("name"): one.get("value") for one in case.find("properties")}
    assert (stated["target"], stated["status"], stated["needed"]) == ("others", "too few paths", "183")
    assert case.find("error").get("message").startswith("gate can't be claimed: 12 situations")


@each_row(("typed", "expected"), [("c1", ["c1", "c10", "c11"]), ("x", [])])
def test_tab_completes_names_of_configurations(before, typed, expected):
    words = f"vastflow replay {before} {typed}"
    environment = {"COMP_WORDS": words, "COMP_CWORD": "3", "_VASTFLOW_COMPLETE": "complete_bash"}
    completed = CliRunner(env=environment).invoke(app, [], prog_name="vastflow")
    assert completed.stdout.split() == expected
