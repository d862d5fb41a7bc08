"""The command `explain`: one configuration, where it came from, where its results are and what a run would do."""

import json
import shutil
from datetime import datetime, timedelta

import pytest
from command_line import called, refused
from room import edited
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.plan import plan as plans
from vastflow.flows.plan.explain import explained as explained_configuration
from vastflow.flows.request.campaign_file import campaign_keys, read_campaign
from vastflow.oracles.judgement.verdict import Verdict, write_verdicts
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Recording, Run
from vastflow.tasks.engine.index import ConfigurationRuns, Index
from vastflow.tasks.store.store import open_store

NOISE = "laserscan_gaussian_noise_std_deviation"


class Place:
    """A campaign that is not executed: its directories, and a store with what it would have left there."""

    def __init__(self, path, folder, tree):
        self.path = path
        self.results = folder / "results"
        self.store = folder / "store"
        self._tree = tree
        self._created = datetime(2026, 11, 21, 6, 5, 4)

    def edit(self, old, new):
        edited(self.path.parent, (self.path.name, old, new))

    def run(self, runs=2):
        """Write a campaign directory, with a block of recordings, a trace and verdicts of each configuration."""
        campaign, oracles = read_campaign(self.path)
        index = Index(open_store(self.store), campaign_keys(self._tree, campaign.seed, oracles))
        for each in instantiate(campaign).configurations:
            stored(index, ConfigurationRuns(each.name, each.family, 1, each.scenario, runs))
        self._created += timedelta(hours=1)
        found = ConfigurationResult([block(runs)])
        return write_results(
            self.path, self.results, found, runs=runs, tree=self._tree, created=self._created
        ).directory


def block(runs):
    return write_recordings([Recording(Run(k, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0), {}) for k in range(runs)])


def stored(index, configuration):
    home = index.keys.recordings(configuration.checked)
    recorded = index.store.put(f"{home}/0-{configuration.runs}", {"recordings.parquet": block(configuration.runs)})
    (found,) = index.blocks(configuration)
    trace = index.store.put(index.trace_key(configuration, found), {"traces.parquet": b"trace"})
    verdicts = write_verdicts([Verdict("success", k, "pass") for k in range(configuration.runs)])
    key = index.keys.verdicts(configuration.checked, recorded.content, trace.content)
    index.store.put(key, {"verdicts.json": verdicts}, {"runs": [[k, "pass"] for k in range(configuration.runs)]})


@pytest.fixture
def place(small_room, tmp_path, tree, monkeypatch):
    monkeypatch.setattr(plans, "installed_tree", lambda: tree)
    return Place(small_room, tmp_path, tree)


def explained(place, directory, name, **options):
    return explained_configuration(directory, name, store=str(place.store), **options)


def test_explain_names_writers_of_values_and_places_of_results(place):
    found = explained(place, place.run(), "room-2")
    written = {(part, each["key"]): each["by"] for part, all_of in found.dimensions.items() for each in all_of}
    assert written == {
        ("environment", "map_file"): "campaign file",
        ("task", "start_pose"): "campaign file",
        ("task", "goal_pose"): "campaign file",
        ("system", NOISE): "ParameterVariationList",
    }
    results = {stage: list(kept.values()) for stage, kept in found.then.items()}
    assert results == {"execute": ["0–1"], "observe": ["0–1"], "judge": ["0–1"]}
    assert all((place.store / key).is_dir() for kept in found.then.values() for key in kept)
    assert [due.stage for due in found.today.due] == ["instantiate"]  # nobody stored what the producer makes


def test_explain_lists_lost_results_of_one_configuration(place):
    directory = place.run()
    shutil.rmtree(place.store / "execute")
    found = explained(place, directory, "room-2")
    assert [[*kept.values()] for kept in found.then.values()] == [[""], [], []]
    due = {(each.stage, each.subject, each.amount): each.reason.kind for each in found.today.due}
    assert due["execute", "room-2", 2] == "lost" and due["judge", "room-2", 2] == "follows"
    assert not any(subject == "room-1" for _, subject, _ in due)


def test_explain_uses_inputs_of_directory(place):
    directory = place.run()
    place.edit("[0.0, 0.02]", "[0.0, 0.03]")
    assert [due.stage for due in explained(place, directory, "room-2").today.due] == ["instantiate"]


def test_explain_compares_with_earlier_campaign(place):
    first = place.run()
    place.edit("[0.0, 0.02]", "[0.0, 0.03]")
    second = place.run()
    found = explained(place, second, "room-2")
    assert found.earlier.directory == first
    assert found.differences == [f"system.{NOISE} from 0.02 to 0.03"]
    assert explained(place, second, "room-1").differences == []
    assert explained(place, first, "room-1").earlier is None
    assert explained(place, first, "room-2", since=second).differences == [f"system.{NOISE} from 0.03 to 0.02"]


def test_explain_finds_configuration_under_other_name_and_original_of_duplicate(place):
    place.run()
    place.edit("- name: room\n", "- name: hall\n")
    found = explained(place, place.run(), "hall-2")
    assert found.differences == ["there is no such configuration; room-2 has the same scenario"]
    place.edit("[0.0, 0.02]", "[0.02, 0.02]")
    directory = place.run()
    found = explained(place, directory, "hall-2")
    assert found.row["duplicate_of"] == "hall-1"
    assert [due.stage for due in found.today.due] == ["instantiate"]
    assert "has the content of hall-1, which was run in its stead" in called("plan", directory, "hall-2").stdout


def test_explain_names_other_code_machine_and_oracle(place):
    first = place.run()
    metadata = json.loads((first / "metadata.json").read_text())
    metadata["numeric_class"] = "riscv64; " + metadata["numeric_class"].partition("; ")[2]
    metadata["source"]["execute"] = "0" * 64
    metadata["code"]["execute"]["files"]["sim.world.lidar"] = "0" * 12
    metadata["seed"] = 3
    metadata["oracles"][0]["parameters"]["allow_missed"] = 7
    (first / "metadata.json").write_text(json.dumps(metadata))
    machine, code, seed, oracle = explained(place, place.run(), "room-1").differences
    assert machine.startswith("numeric class changed: architecture from 'riscv64' to ")
    assert seed == "execution.seed changed: from 3 to 0"
    assert code == "source of execute changed: sim.world.lidar"
    assert oracle.startswith("parameters of oracle success changed: allow_missed from 7 to ")


def test_explain_leaves_today_open_without_inputs(place):
    directory = place.run()
    shutil.rmtree(directory / "inputs")
    found = explained(place, directory, "room-1")  # its environment is kept beside
    assert found.today is None and "its inputs can't be read any more" in found.obstacle
    assert "can't be told" in called("plan", directory, "room-1", "--store", place.store).stdout
    shutil.rmtree(directory / "environments")
    with pytest.raises(UnusableDirectory, match=r"damaged campaign directory: no file has the digest"):
        explained(place, directory, "room-1")


def test_explain_prints_text_and_json(place):
    first = place.run()
    place.edit("[0.0, 0.02]", "[0.0, 0.03]")
    second = place.run()
    result = called("plan", second, "room-2", "--store", place.store)
    assert result.exit_code == 0, result.stderr
    assert "room-2 of family room, small_room of 2026-11-21T08:05:04" in result.stdout
    assert f"system.{NOISE} from 0.02 to 0.03" in result.stdout
    said = json.loads(called("plan", second, "room-2", "--store", place.store, "--json").stdout)
    assert said["dimensions"]["system"] == [{"key": NOISE, "value": 0.03, "by": "ParameterVariationList"}]
    assert said["today"]["stages"]["judge"] == {"reused": 2, "computed": 0}
    assert said["today"]["scenario_digest"] == said["scenario_digest"]
    assert said["compared_with"] == str(first)


def test_explain_refuses_wrong_arguments(place, tmp_path):
    directory = place.run()
    for arguments, words in [
        ((directory, "room-3"), "expected the name of a configuration, got 'room-3'; did you mean 'room-"),
        ((directory, "x"), "got 'x'; known: room-1, room-2"),
        ((tmp_path / "nowhere", "room-1"), "no such folder"),
        ((place.path, "room-1"), "expected a campaign directory to explain CONFIGURATION, got a file"),
        ((place.results, "room-1"), "holds 1 campaign directories"),
        ((directory, "room-1", "--since", tmp_path), "--since "),
        ((directory, "room-1", "--store", "nowhere://x"), "nowhere"),
    ]:
        assert words in refused("plan", *arguments)
