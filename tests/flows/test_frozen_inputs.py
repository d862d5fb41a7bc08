"""A campaign directory has all that its plug-ins use: it can be asked again when the original is gone."""

import re
import shutil
from pathlib import Path

import pytest
from room import SMALL_ROOM

from vastflow.flows.request.campaign_file import campaign_keys, read_campaign
from vastflow.flows.request.run_request import Asked
from vastflow.flows.results.inputs import inputs_of, replica
from vastflow.oracles.results.executed import KeptFiles
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.world.world import read_world
from vastflow.tasks.engine.bundle import Packer
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import open_store

VAST = f"""{SMALL_ROOM.partition("variations:")[0].replace("room.yaml", "maps/room.yaml")}variations:
      - own.py:Own: {{}}
execution: {{runs: 1, nav2_params: my_pursuit.yaml}}
evaluation: {{oracles: [OFOLDERown_oracle.py:Limited]}}
"""
PRODUCER = """
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer
from lib.values import VALUES

class Own(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {"scan_noise_std": "system"}

    def produce(self, inputs, draws):
        for value in VALUES:
            yield Fragment({"scan_noise_std": value})
"""
ORACLE = """
import json, os
from pathlib import Path
from vastflow.oracles.judgment.oracle import Oracle, Parameters
import limits

class Limited(Oracle[Parameters]):
    Parameters = Parameters
    metrics = {}
    files = ["data/limit.json", "../shared.json"]

    def judge(self, trace, situation):
        return self.passed(trace) if not os.getenv("STRICT") else self.failed(trace, "strict")
"""


PAGE = (Path(__file__).parents[2] / "docs" / "write-a-controller.md").read_text()
CONTROLLER = dict(re.findall(r"^```\w+ (my_pursuit\.\w+)\n((?:.*\n)*?)^```$", PAGE, re.MULTILINE))


def scenarios_of(campaign):
    return [configuration.scenario for configuration in instantiate(campaign).configurations]


def controllers(scenarios):
    return {type(parameters_of(scenario.system).controller).__name__ for scenario in scenarios}


@pytest.mark.parametrize("oracle_folder", ["", "../oracles/"])
def test_campaign_directory_is_complete_without_the_campaigns_folder(tmp_path, small_room, monkeypatch, oracle_folder):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    home = tmp_path / "all" / "campaign"
    judges = home / oracle_folder
    for file, text in {
        home / "x.vast": VAST.replace("OFOLDER", oracle_folder),
        home / "own.py": PRODUCER,
        home / "lib" / "__init__.py": "",
        home / "lib" / "values.py": "VALUES = [0.01, 0.02]\n",
        home / "not_used.py": "",
        judges / "own_oracle.py": ORACLE,
        judges / "limits.py": "LIMIT = 1\n",
        judges / "data" / "limit.json": "1",
        judges / ".." / "shared.json": "2",
        **{home / name: text for name, text in CONTROLLER.items()},
    }.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.resolve().write_text(text)
    shutil.copytree(small_room.parent, home / "maps")
    campaign, oracles = read_campaign(home / "x.vast")
    tree = installed_tree()
    keys = campaign_keys(tree, 0, oracles)
    producer = tree.plug_in_digest(type(campaign.families[0].producers[0]))
    (note,) = [note for note in campaign.notes if note.place.file.endswith(".py")]
    assert str(note).startswith(str(home / f"{oracle_folder}own_oracle.py") + ":13:1: warning: os.getenv: ")
    assert str(note).endswith("is in no key, so that an edit of it goes unnoticed. Use a parameter in its place.")
    bundle = Packer(store := open_store(tmp_path / "store")).packed(scenarios_of(campaign))
    (home / "lib" / "values.py").write_text("VALUES = [0.5]\n")  # while it runs
    (home / "my_pursuit.py").write_text("raise SystemExit\n")
    inputs = inputs_of(campaign, oracles)
    directory = tmp_path / "results"
    directory.mkdir()
    inputs.write(directory)
    assert (directory / "inputs" / "lib" / "values.py").read_text() == "VALUES = [0.01, 0.02]\n"
    kept = {path.name for path in (directory / "inputs").rglob("*") if path.is_file()}
    assert {"own.py", "own_oracle.py", "limits.py", "limit.json", "shared.json"} <= kept
    assert "not_used.py" not in kept
    shutil.rmtree(tmp_path / "all")
    shutil.rmtree(tmp_path / "cache")
    assert controllers(bundle.opened(store)) == {"PurePursuit"}
    with replica(directory, Asked("x.vast", 1, (), inputs.places)) as laid_out:
        again, judges_again = read_campaign(laid_out.file)
        assert campaign_keys(installed_tree(), 0, judges_again) == keys
        assert controllers(scenarios_of(again)) == {"PurePursuit"}
        assert installed_tree().plug_in_digest(type(again.families[0].producers[0])) == producer
    shutil.rmtree(directory / "inputs" / "lib")
    with (
        pytest.raises(UnusableDirectory, match="No module named 'lib'"),
        replica(directory, Asked("x.vast", 1, (), inputs.places)),
    ):
        pass


def test_inputs_have_controller_beside_parameter_file_of_other_folder(small_room, tmp_path):
    for name, text in CONTROLLER.items():
        (tmp_path / name).write_text(text)
    small_room.write_text(f"{small_room.read_text()}  nav2_params: ../my_pursuit.yaml\n")
    campaign, oracles = read_campaign(small_room)
    (tmp_path / "my_pursuit.py").write_text("raise SystemExit\n")  # while it runs
    inputs = inputs_of(campaign, oracles)
    inputs.write(tmp_path)
    (kept,) = (tmp_path / "inputs").rglob("my_pursuit.py")
    assert kept.read_text() == CONTROLLER["my_pursuit.py"] and kept.with_suffix(".yaml").is_file()
    with replica(tmp_path, Asked("room.vast", 1, places=inputs.places)) as again:
        assert controllers(scenarios_of(read_campaign(again.file)[0])) == {"PurePursuit"}


@pytest.mark.parametrize(("file", "place"), [("c.vast", "{}/away"), ("{}/away", "x")])
def test_directory_from_elsewhere_is_laid_out_inside_a_folder(tmp_path, file, place):
    (tmp_path / "inputs").mkdir()
    for path in ("campaign.vast", "inputs/x"):
        (tmp_path / path).write_text("")
    asked = Asked(file.format(tmp_path), 1, places={place.format(tmp_path): "x"})
    with pytest.raises(UnusableDirectory, match="expected a path inside the folder"), replica(tmp_path, asked):
        pass
    assert not (tmp_path / "away").exists()


def test_kept_inputs_have_world_with_its_included_files(small_room, tmp_path):
    crate = "<model name='c'><link name='l'><collision name='c'><geometry><box><size>1 1 1</size></box></geometry>"
    crate = f"<sdf version='1.6'>{crate}</collision></link></model></sdf>"
    world = "<sdf version='1.6'><world name='w'><include><uri>model://crate</uri></include></world></sdf>"
    home = small_room.parent
    for name, text in {"worlds/w.sdf": world, "models/crate/model.sdf": crate}.items():
        (home / name).parent.mkdir(parents=True)
        (home / name).write_text(text)
    text = small_room.read_text()
    at = text.index("map_file:")
    lines = text[at:].split("\n", 1)
    indent = text[text.rindex("\n", 0, at) + 1 : at]
    small_room.write_text(f"{text[:at]}{lines[0]}\n{indent}world: worlds/w.sdf\n{lines[1]}")
    campaign, oracles = read_campaign(small_room)
    given = campaign.families[0].values["world"]
    inputs = inputs_of(campaign, oracles)
    shutil.rmtree(home / "worlds")
    shutil.rmtree(home / "models")
    directory = tmp_path / "results"
    directory.mkdir()
    inputs.write(directory)
    assert set(inputs.worlds) == {campaign.families[0].values["map_file"].digest, given.digest}
    assert read_world(KeptFiles(directory).content(given.digest)).bodies
