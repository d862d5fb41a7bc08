"""The command `explain`: one configuration, where it came from, where its results are and what a run would do."""

import json
import shutil
from functools import partial

import pytest
from command_line import called, refused

from vastflow.flows.plan import plan as plans
from vastflow.flows.plan.explain import explained as explained_configuration
from vastflow.oracles.results.unusable import UnusableDirectory

NOISE = "laserscan_gaussian_noise_std_deviation"
OTHER_NOISE = ("[0.0, 0.02]", "[0.0, 0.03]")


@pytest.fixture
def store(tmp_path):
    return tmp_path / "store"


@pytest.fixture
def explained(store, tree, monkeypatch):
    monkeypatch.setattr(plans, "installed_tree", lambda: tree)
    return partial(explained_configuration, store=str(store))


def test_explain_names_writers_of_values_and_places_of_results(ran, store, explained):
    found = explained(ran(), "room-2")
    written = {(part, each["key"]): each["by"] for part, all_of in found.dimensions.items() for each in all_of}
    assert written == {
        ("environment", "map_file"): "campaign file",
        ("task", "start_pose"): "campaign file",
        ("task", "goal_pose"): "campaign file",
        ("system", NOISE): "ParameterVariationList",
    }
    results = {stage: list(kept.values()) for stage, kept in found.then.items()}
    assert results == {"execute": ["0–1"], "observe": ["0–1"], "judge": ["0–1"]}
    assert all((store / key).is_dir() for kept in found.then.values() for key in kept)
    assert found.today.due == []


def test_explain_lists_lost_results_of_one_configuration(ran, store, explained):
    directory = ran()
    shutil.rmtree(store / "execute")
    found = explained(directory, "room-2")
    assert [[*kept.values()] for kept in found.then.values()] == [[""], [], []]
    due = {(each.stage, each.subject, each.amount): each.reason.kind for each in found.today.due}
    assert due["execute", "room-2", 2] == "lost" and due["judge", "room-2", 2] == "follows"
    assert not any(subject == "room-1" for _, subject, _ in due)


def test_explain_compares_with_earlier_campaign(ran, explained):
    first = ran()
    second = ran(*OTHER_NOISE)
    found = explained(second, "room-2")
    assert found.earlier.directory == first
    assert found.differences == [f"system.{NOISE} from 0.02 to 0.03"]
    assert explained(second, "room-1").differences == []
    alone = explained(first, "room-2")  # from the inputs in its directory, for the campaign file is another
    assert alone.earlier is None and alone.today.due == []
    assert explained(first, "room-2", since=second).differences == [f"system.{NOISE} from 0.03 to 0.02"]


def test_explain_finds_configuration_under_other_name_and_original_of_duplicate(ran, explained):
    ran()
    found = explained(ran("- name: room\n", "- name: hall\n"), "hall-2")
    assert found.differences == ["there is no such configuration; room-2 has the same scenario"]
    directory = ran("[0.0, 0.02]", "[0.02, 0.02]")
    found = explained(directory, "hall-2")
    assert found.row["duplicate_of"] == "hall-1"
    assert found.today.due == []
    assert "has the content of hall-1, which was run in its stead" in called("plan", directory, "hall-2").stdout


def test_explain_names_other_code_machine_and_oracle(ran, explained):
    first = ran()
    metadata = json.loads((first / "metadata.json").read_text())
    metadata["numeric_class"] = "riscv64; " + metadata["numeric_class"].partition("; ")[2]
    metadata["source"]["execute"] = "0" * 64
    metadata["code"]["execute"]["files"]["sim.world.lidar"] = "0" * 12
    metadata["seed"] = 3
    metadata["oracles"][0]["parameters"]["allow_missed"] = 7
    (first / "metadata.json").write_text(json.dumps(metadata))
    machine, code, seed, oracle = explained(ran(), "room-1").differences
    assert machine.startswith("numeric class changed: architecture from 'riscv64' to ")
    assert seed == "execution.seed changed: from 3 to 0"
    assert code == "source of execute changed: sim.world.lidar"
    assert oracle.startswith("parameters of oracle success changed: allow_missed from 7 to ")


def test_explain_leaves_today_open_without_inputs(ran, store, explained):
    directory = ran()
    shutil.rmtree(directory / "inputs")
    found = explained(directory, "room-1")  # its environment is kept beside
    assert found.today is None and "its inputs can't be read any more" in found.obstacle
    assert "can't be told" in called("plan", directory, "room-1", "--store", store).stdout
    shutil.rmtree(directory / "environments")
    with pytest.raises(UnusableDirectory, match=r"damaged campaign directory: no file has the digest"):
        explained(directory, "room-1")


def test_explain_prints_text_and_json(ran, store, explained):
    first = ran()
    second = ran(*OTHER_NOISE)
    result = called("plan", second, "room-2", "--store", store)
    assert result.exit_code == 0, result.stderr
    assert "room-2 of family room, small_room of 2026-11-21T08:05:04" in result.stdout
    assert f"system.{NOISE} from 0.02 to 0.03" in result.stdout
    said = json.loads(called("plan", second, "room-2", "--store", store, "--json").stdout)
    assert said["dimensions"]["system"] == [{"key": NOISE, "value": 0.03, "by": "ParameterVariationList"}]
    assert said["today"]["stages"]["judge"] == {"reused": 2, "computed": 0}
    assert said["today"]["scenario_digest"] == said["scenario_digest"]
    assert said["compared_with"] == str(first)


def test_explain_refuses_wrong_arguments(ran, small_room, tmp_path):
    directory = ran()
    for arguments, words in [
        ((directory, "room-3"), "expected the name of a configuration, got 'room-3'; did you mean 'room-"),
        ((directory, "x"), "got 'x'; known: room-1, room-2"),
        ((small_room, "room-1"), "expected a campaign directory to explain CONFIGURATION, got a file"),
        ((directory, "room-1", "--since", tmp_path), "--since "),
        ((directory, "room-1", "--store", "nowhere://x"), "nowhere"),
    ]:
        assert words in refused("plan", *arguments)
