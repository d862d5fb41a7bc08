"""Bundles: what is unpacked elsewhere is what was packed, and says so where it is not."""

import os
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from vastflow.oracles.judgement.registry import oracles_of
from vastflow.sim.model.digest import FileContent, file_digest
from vastflow.sim.model.scenario import ProcessSetup, Scenario
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.reading.abstract import abstract_content, definition_of
from vastflow.sim.scenario.programs.folders import copy_in, files_matching
from vastflow.sim.world.map_file import load_map, map_content
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.engine.remote_shard import BundleError, Packer, differences, promise_of, unpacked
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import Lost, open_store

KEYS = Keys("x86; glibc", "a", "b", "c", 7, [["success", {}]])
ORACLE = """
from vastflow.oracles.judgement.oracle import Oracle, Parameters

class Nobody(Oracle):
    class Parameters(Parameters):
        limit: float = 1.5
    metrics = {}

    def judge(self, trace, situation):
        return self.passed(trace)
"""
OSC = """
import {library}
scenario driving:
    do serial:
        log("done")
"""


@pytest.fixture
def home(tmp_path) -> Path:
    """A campaign's folder; what it uses is partly beside it."""
    home = tmp_path / "there" / "campaign"
    (home / "tools").mkdir(parents=True)
    (home.parent / "maps" / "pictures").mkdir(parents=True)
    cells = np.full((40, 40), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 0
    Image.fromarray(cells).save(home.parent / "maps" / "pictures" / "hall.pgm")
    header = "{image: pictures/hall.pgm, resolution: 0.05, origin: [0, 0, 0]}"
    (home.parent / "maps" / "hall.yaml").write_text(header)
    (home / "judge.py").write_text(ORACLE)
    (home / "drive.osc").write_text(OSC.format(library='"lib/words.osc"'))
    (home / "lib").mkdir()
    (home / "lib" / "words.osc").write_text("import osc.helpers\n")
    (home / "nav2.yaml").write_text("controller_server: {ros__parameters: {controller_frequency: 15.0}}\n")
    (home / "tools" / "drive.sh").write_text("#!/bin/sh\n")
    (home / "tools" / "drive.sh").chmod(0o755)
    (home / "tools" / "notes.txt").write_text("no program\n")
    return home


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


def configuration(home, name="hall-1", **parts):
    """A configuration that uses files of every kind."""
    scenario = Scenario(
        abstract_content(home / "drive.osc"),
        30,
        {"map_file": map_content(home / ".." / "maps" / "hall.yaml"), "obstacles": [{"x": 1.0, "name": "box"}]},
        {"start_pose": {"x": 1.0, "y": -0.0, "yaw": 1e-300}},
        {"nav2": nav2_file(home / "nav2.yaml"), "noise": 0.1, "on": True, "n": 3, "nothing": None, "inf": float("inf")},
        ProcessSetup(files_matching(home, ["tools/*"]), {"A": "1"}, "tools/drive.sh", ""),
    )
    return replace(ConfigurationRuns(name, "hall", 1, scenario, 5), **parts)


def oracles(home):
    return oracles_of([("judge.py:Nobody", {"limit": 0.25})], home)


def packed(store, home, configurations):
    return Packer(store, "hall", KEYS, oracles(home), home).packed(configurations)


def test_configurations_come_out_as_they_went_in_with_files_of_their_own(store, home, tmp_path):
    key = packed(store, home, [configuration(home), configuration(home, "hall-2", place=2, runs=9)])
    (tmp_path / "there").rename(tmp_path / "gone")
    here = tmp_path / "here"
    bundle = unpacked(store, key, here)
    first, second = bundle.configurations
    assert (second.name, second.family, second.place, second.runs) == ("hall-2", "hall", 2, 9)
    map_file = first.scenario.environment["map_file"]
    assert Path(map_file.path).is_relative_to(here)
    assert load_map(map_file.path).digest == map_file.digest
    assert definition_of(first.scenario.abstract).name == "driving"
    assert (bundle.campaign, bundle.seed) == ("hall", 7)


def test_digest_of_a_scenario_stays_the_same(store, home, tmp_path):
    before = configuration(home)
    (after,) = unpacked(store, packed(store, home, [before]), tmp_path / "here").configurations
    assert after.scenario.digest == before.scenario.digest
    assert after.scenario.situation_digest == before.scenario.situation_digest
    assert nav2_file(after.scenario.system["nav2"].path).digest == before.scenario.system["nav2"].digest


def test_programs_are_executable_where_they_were(store, home, tmp_path):
    (after,) = unpacked(store, packed(store, home, [configuration(home)]), tmp_path / "here").configurations
    copy_in(after.scenario.programs.files, tmp_path / "run")
    assert os.access(tmp_path / "run" / "tools" / "drive.sh", os.X_OK)
    assert not (tmp_path / "run" / "tools" / "notes.txt").stat().st_mode & stat.S_IXUSR


def test_oracles_of_a_file_keep_name_and_parameters(store, home, tmp_path):
    bundle = unpacked(store, packed(store, home, [configuration(home)]), tmp_path / "here")
    assert [oracle.name for oracle in bundle.oracles] == ["success", "judge.py:Nobody"]
    assert bundle.oracles[1].parameters.limit == 0.25
    assert bundle.oracles[1].base.is_relative_to(tmp_path / "here")


def test_oracle_beside_the_campaigns_folder_is_found(store, home, tmp_path):
    (home / "judge.py").rename(home.parent / "judge.py")
    beside = oracles_of([("../judge.py:Nobody", {})], home)
    key = Packer(store, "hall", KEYS, beside, home).packed([configuration(home)])
    assert unpacked(store, key, tmp_path / "here").oracles[1].name == "../judge.py:Nobody"


def test_same_configurations_give_the_same_bundle_wherever_the_campaign_lies(store, home, tmp_path):
    first = packed(store, home, [configuration(home)])
    moved = tmp_path / "moved"
    home.parent.rename(moved)
    assert packed(store, moved / "campaign", [configuration(moved / "campaign")]) == first


def test_file_is_stored_once_for_all_bundles(store, home):
    packed(store, home, [configuration(home)])
    before = {holding.key for holding in store.holdings()}
    packed(store, home, [configuration(home, "hall-2")])
    assert len({holding.key for holding in store.holdings()} - before) == 1


def test_bundle_that_lost_a_file_is_lost(store, home, tmp_path):
    key = packed(store, home, [configuration(home)])
    sha256 = file_digest(home / "judge.py")
    store.remove([f"bundle/{sha256[:2]}/{sha256}"])
    with pytest.raises(Lost, match="is not in the store"):
        unpacked(store, key, tmp_path / "here")
    assert packed(store, home, [configuration(home)]) == key
    unpacked(store, key, tmp_path / "here")


def test_forged_bundle_is_not_imported(store, home, tmp_path):
    key = packed(store, home, [configuration(home)])
    sha256 = file_digest(home / "judge.py")
    forged = {
        f"bundle/{sha256[:2]}/{sha256}": {"content": f"open({str(tmp_path / 'ran')!r}, 'w')\n{ORACLE}".encode()},
        key: {"bundle.json": store.read(key, "bundle.json").replace(b"0.25", b"0.75")},
    }
    for artifact, files in forged.items():
        store.remove([artifact])
        store.put(artifact, files)
        with pytest.raises(Lost, match="is not the content of its key"):
            unpacked(store, key, tmp_path / "here")
        assert not (tmp_path / "ran").exists()
        assert packed(store, home, [configuration(home)]) == key
        unpacked(store, key, tmp_path / f"after {len(artifact)}")


def test_file_that_changed_since_is_noticed(store, home, tmp_path):
    before = configuration(home)
    (home / "drive.osc").write_text(OSC.format(library="osc.helpers").replace("done", "changed"))
    key = packed(store, home, [before])
    (after,) = unpacked(store, key, tmp_path / "here").configurations
    with pytest.raises(ValueError, match="changed since the campaign was read"):
        definition_of(after.scenario.abstract)


def test_file_that_is_gone_is_named(store, home):
    before = configuration(home)
    (home / "nav2.yaml").unlink()
    with pytest.raises(BundleError, match=r"nav2\.yaml can't be read \(No such file or directory\)"):
        packed(store, home, [before])


def test_differences_between_machines_have_names():
    assert differences(promise_of(KEYS), KEYS) == []
    other = replace(KEYS, numeric="arm", judge_source="d", oracles=[["success", {"limit": 1}]])
    assert differences(promise_of(KEYS), other) == [
        "the numeric class",
        "the code that judges them",
        "the oracles' parameters",
    ]


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=12,
)


@given(values=st.dictionaries(st.text(max_size=4), values, max_size=4))
def test_whatever_a_scenario_says_keeps_its_digest(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("bundle")
    file = folder / "file"
    file.write_bytes(b"content")
    scenario = Scenario("builtin:navigate_to_pose", 1.0, {**values, "f": FileContent(str(file), "d")}, values, {})
    store = open_store(folder / "store")
    key = Packer(store, "any", KEYS, (), folder).packed([ConfigurationRuns("a-1", "a", 1, scenario, 1)])
    (after,) = unpacked(store, key, folder / "here").configurations
    assert after.scenario.digest == scenario.digest


def test_scenario_file_that_became_wrong_is_a_fault_of_the_bundle(store, home):
    before = configuration(home)
    (home / "drive.osc").write_text("scenario")
    with pytest.raises(BundleError, match=r"drive\.osc:1.*changed since the campaign was read"):
        packed(store, home, [before])
