"""Bundles: what is opened elsewhere is what was packed, and says so where it is not."""

import os
import stat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from vastflow.oracles.judgment.registry import oracles_of
from vastflow.sim.model.digest import FileContent, file_digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup, Scenario
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.reading.abstract import abstract_content, definition_of
from vastflow.sim.scenario.programs.folders import copy_in, files_matching
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.world import map_content, read_world, world_content
from vastflow.tasks.engine.bundle import Packer
from vastflow.tasks.store.store import StoreError, open_store

ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters

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


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


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


def scenario(home):
    """A scenario that uses files of every kind."""
    return Scenario(
        abstract_content(home / "drive.osc"),
        30,
        {"map_file": map_content(home / ".." / "maps" / "hall.yaml"), "obstacles": [{"x": 1.0, "name": "box"}]},
        {"start_pose": {"x": 1.0, "y": -0.0, "yaw": 1e-300}},
        {"nav2": nav2_file(home / "nav2.yaml"), "noise": 0.1, "on": True, "n": 3, "nothing": None, "inf": float("inf")},
        ProcessSetup(files_matching(home, ["tools/*"]), {"A": "1"}, "tools/drive.sh", ""),
    )


def oracles(home, name="judge.py:Nobody"):
    return oracles_of([(name, {"limit": 0.25})], home)


def file_key(path):
    sha256 = file_digest(path)
    return f"bundle/{sha256[:2]}/{sha256}"


def test_scenario_keeps_its_digests_and_has_files_of_its_own(store, home, tmp_path):
    before = scenario(home)
    bundle = Packer(store).packed([before, store])
    (tmp_path / "there").rename(tmp_path / "gone")
    after, same = bundle.opened(store)
    assert same is store
    assert (after.digest, after.situation_digest) == (before.digest, before.situation_digest)
    map_file = after.environment["map_file"]
    assert load_map(map_file.path).digest == map_file.digest
    assert definition_of(after.abstract).name == "driving"
    assert nav2_file(after.system["nav2"].path).digest == before.system["nav2"].digest
    copy_in(after.programs.files, tmp_path / "run")
    assert os.access(tmp_path / "run" / "tools" / "drive.sh", os.X_OK)
    assert not (tmp_path / "run" / "tools" / "notes.txt").stat().st_mode & stat.S_IXUSR


def test_world_is_sent_with_files_that_it_includes(store, tmp_path):
    crate = (
        "<model name='c'><link name='l'><collision name='c'><geometry><sphere><radius>1</radius></sphere></geometry>"
    )
    texts = {
        "worlds/w.sdf": "<sdf version='1.6'><world name='w'><include><uri>model://crate</uri></include></world></sdf>",
        "models/crate/model.sdf": f"<sdf version='1.6'>{crate}</collision></link></model></sdf>",
    }
    for name, text in texts.items():
        (tmp_path / "there" / name).parent.mkdir(parents=True)
        (tmp_path / "there" / name).write_text(text)
    bundle = Packer(store).packed([world_content(tmp_path / "there" / "worlds" / "w.sdf")])
    (tmp_path / "there").rename(tmp_path / "gone")
    (content,) = bundle.opened(store)
    assert len(read_world(content).bodies) == 1


@pytest.mark.parametrize("place", ["judge.py", "../judge.py"])
def test_oracles_of_file_keep_name_parameters_and_code(store, home, tmp_path, place):
    (home / "judge.py").rename(home / place)
    bundle = Packer(store).packed(oracles(home, f"{place}:Nobody"))
    (home / place).write_text("raise SystemExit\n")
    _, after = bundle.opened(store)
    assert (after.name, after.parameters.limit) == (f"{place}:Nobody", 0.25)


def test_file_is_stored_once_for_all_bundles(store, home):
    packer = Packer(store)
    packer.packed(scenario(home))
    before = store.holdings()
    assert packer.packed([scenario(home), 1]).files == Packer(store).packed(scenario(home)).files
    assert store.holdings() == before


def test_bundle_that_lost_file_is_error_of_store(store, home):
    bundle = Packer(store).packed(scenario(home))
    store.remove([file_key(home / "nav2.yaml")])
    with pytest.raises(StoreError, match="Expected a folder that all machines share"):
        bundle.opened(store)
    assert Packer(store).packed(scenario(home)).opened(store).digest == scenario(home).digest


def test_forged_file_is_refused(store, home, tmp_path):
    bundle = Packer(store).packed(oracles(home))
    key = file_key(home / "judge.py")
    store.remove([key])
    store.put(key, {"content": f"open({str(tmp_path / 'ran')!r}, 'w')\n{ORACLE}".encode()})
    with pytest.raises(StoreError, match="is not the content of its key"):
        bundle.opened(store)
    assert not (tmp_path / "ran").exists()


def test_file_that_changed_since_is_noticed(store, home):
    before = scenario(home)
    (home / "drive.osc").write_text(OSC.format(library="osc.helpers").replace("done", "changed"))
    after = Packer(store).packed(before).opened(store)
    with pytest.raises(ValueError, match="changed since the campaign was read"):
        definition_of(after.abstract)


def test_packer_names_missing_file(store, home):
    before = scenario(home)
    (home / "nav2.yaml").unlink()
    with pytest.raises(ScenarioError, match=r"nav2\.yaml: No such file.*workers elsewhere need it"):
        Packer(store).packed(before)


def test_scenario_file_that_became_wrong_is_named(store, home):
    before = scenario(home)
    (home / "drive.osc").write_text("scenario")
    with pytest.raises(ScenarioError, match=r"drive\.osc:1.*changed since the campaign was read"):
        Packer(store).packed(before)


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=12,
)


@given(values=st.dictionaries(st.text(max_size=4), values, max_size=4))
def test_scenario_keeps_digest_for_any_values(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("bundle")
    file = folder / "file"
    file.write_bytes(b"content")
    before = Scenario("builtin:navigate_to_pose", 1.0, {**values, "f": FileContent(str(file), "d")}, values, {})
    store = open_store(folder / "store")
    assert Packer(store).packed(before).opened(store).digest == before.digest
