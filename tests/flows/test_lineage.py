"""The lineage of a run's verdicts: keys of all that they follow from, read without executing anything."""

import json
import shutil

import pytest
from command_line import called, refused
from table import each_row

from vastflow.flows.results.lineage import lineage_of, lineage_text
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.digest import file_digest
from vastflow.tasks.store.store import open_store

ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


class OwnParameters(Parameters):
    most: int


class Own(Oracle[OwnParameters]):
    Parameters = OwnParameters
    metrics = {}

    def judge(self, trace, situation):
        return self.passed(trace)
"""
JUDGED_BY_OWN = "execution:\n  runs: 2\nevaluation: {oracles: [own.py:Own: {most: 3}]}\n"


@pytest.fixture
def directory(ran, small_room):
    """A campaign with an oracle of its own, whose code in the directory can't be imported any more."""
    small_room.with_name("own.py").write_text(ORACLE)
    found = ran("execution:\n  runs: 2\n", JUDGED_BY_OWN)
    (found / "inputs" / "own.py").write_text("raise SystemExit('executed')")
    shutil.rmtree(small_room.parent)
    return found


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


def manifests(store, stage):
    return {file.parent.relative_to(store.place).as_posix() for file in store.local.glob(f"{stage}/**/manifest")}


def steps_of(directory, store, run="room-1"):
    return {step.step: step for step in lineage_of(directory, run, 1, store)}


def test_lineage_leads_from_verdicts_to_campaign_file_by_keys_in_the_store(directory, store):
    steps = lineage_of(directory, "room-2", 1, store)
    assert [step.step for step in steps] == ["judge", "observe", "execute", "scenario", "instantiate", "campaign"]
    stored = {step.step: step.key for step in steps if step.is_stored}
    assert stored.keys() == {"judge", "observe", "execute", "instantiate"}
    assert {stored["instantiate"]} == manifests(store, "evaluate")
    for stage in ("judge", "observe", "execute"):
        assert stored[stage] in manifests(store, stage)
        other = {step.step: step.key for step in lineage_of(directory, "room-1", 1, store)}
        assert manifests(store, stage) == {stored[stage], other[stage]}
    assert steps[-1].key == file_digest(directory / "campaign.vast")


def test_lineage_shows_oracles_robot_seed_and_values_of_producers(directory, store):
    steps = steps_of(directory, store, "room-2")
    own = steps["judge"].facts["oracles"][1]
    assert (own["oracle"], own["judgment"], own["parameters"]) == ("own.py:Own", "not judged", {"most": 3})
    metadata = json.loads((directory / "metadata.json").read_text())
    assert own["source"] == metadata["oracles"][1]["source"]
    executed = steps["execute"].facts
    assert (executed["seed"], executed["outcome"], executed["source"]) == (
        "0",
        "succeeded",
        metadata["source"]["execute"],
    )
    assert executed["robot"] == metadata["robots"][0]["summary"]
    assert (directory / "environments" / executed["world"]).is_dir()
    made = steps["instantiate"].facts
    assert (made["producer"], made["choice"]) == ("ParameterVariationList", 2)
    assert made["wrote"] == {"laserscan_gaussian_noise_std_deviation": 0.02}


def test_lineage_marks_missing_artifacts_and_unknown_keys(directory, store):
    kept = steps_of(directory, store)
    store.remove([kept["judge"].key])
    assert steps_of(directory, store)["judge"].is_stored is False
    store.remove([kept["observe"].key])
    found = steps_of(directory, store)
    assert (found["observe"].key, found["observe"].is_stored) == (kept["observe"].key, False)
    assert (found["judge"].key, found["judge"].is_stored) == (None, None)
    store.remove([kept["execute"].key, kept["instantiate"].key])
    found = steps_of(directory, store)
    assert kept["execute"].key.startswith(found["execute"].key) and found["execute"].is_stored is False
    assert (found["observe"].key, found["instantiate"].is_stored) == (None, False)
    lines = [*lineage_text(lineage_of(directory, "room-1", 1, store))]
    assert ("observe", "", "key unknown, as it follows from what the store lacks") in lines


def test_lineage_has_no_key_of_verdicts_when_sources_of_oracles_are_missing(directory, store, tmp_path):
    old = shutil.copytree(directory, tmp_path / directory.name)
    metadata = json.loads((old / "metadata.json").read_text())
    del metadata["source"]["oracles"]
    (old / "metadata.json").write_text(json.dumps(metadata))
    steps = lineage_of(old, "room-1", 0, store)
    assert [step.is_stored for step in steps[:3]] == [None, True, True]
    assert next(iter(lineage_text(steps))) == ("judge", "", "key unknown")


def test_lineage_of_a_design_finds_its_evaluations(ran, store):
    found = ran("    variations:\n", "    design: {t_way: {strength: 1}}\n    variations:\n")
    steps = lineage_of(found, "room-1", 0, store)
    assert {step.key for step in steps if step.step == "instantiate"} == manifests(store, "evaluate")


def test_lineage_of_a_point_of_a_search_knows_no_key_of_its_evaluations(directory, store):
    metadata = json.loads((directory / "metadata.json").read_text())
    (directory / "metadata.json").write_text(json.dumps(metadata | {"search": {}, "producers": {}}))
    steps = lineage_of(directory, "room-2", 0, store)
    assert [(step.key, step.is_stored) for step in steps if step.step == "instantiate"] == [(None, None)]
    lines = [*lineage_text(steps)]
    assert ("instantiate", "", "key unknown") in lines and ("", "", "ParameterVariationList, choice 2") in lines


def test_show_prints_lineage_as_text_and_json(directory, store):
    options = ("--lineage", "--store", store.place)
    said = json.loads(called("show", directory, "room-2/1", *options, "--json").stdout)
    assert said == [json.loads(json.dumps(step.as_json())) for step in lineage_of(directory, "room-2", 1, store)]
    text = called("show", directory, "room-2/1", *options).stdout
    for step in said:
        assert step["key"] in text
    assert (
        "ParameterVariationList, choice 2 (dimension: nothing; name: 'laserscan_gaussian_noise_std_deviation'; values: [0.0, 0.02]; "
        in text
    )
    assert "own.py:Own: not judged" in text and "(most: 3; source " in text
    assert "laserscan_gaussian_noise_std_deviation = 0.02" in text
    assert text.count("in the store") == 4


@each_row(
    ("arguments", "words"),
    [
        (("--lineage",), "--lineage: expected RESULTS and CONFIGURATION/RUN"),
        (("room-1/0",), "CONFIGURATION/RUN: requires --lineage, got 'room-1/0' alone"),
        (("--store", "s"), "--store: requires --lineage, got 's' alone"),
        (("room-1", "--lineage"), "expected CONFIGURATION/RUN, such as room-1/0, got 'room-1'"),
        (("room-3/0", "--lineage"), "Unknown configuration 'room-3'. Did you mean 'room-"),
        (("room-1/2", "--lineage"), "no run 2 of room-1. It has 0, 1"),
    ],
)
def test_show_refuses_lineage_of_no_run(directory, arguments, words):
    assert words in refused("show", directory, *arguments)


def test_lineage_reports_a_damaged_directory(directory, store):
    (directory / "verdicts.parquet").write_bytes(b"PAR1")
    with pytest.raises(UnusableDirectory, match="damaged campaign directory"):
        lineage_of(directory, "room-1", 0, store)
