"""Spellings of a campaign file's path change neither its results nor its keys."""

import os
from pathlib import Path

import pytest
from room import ORACLE

from vastflow.flows.request.campaign_file import campaign_keys, campaign_name, read_campaign
from vastflow.flows.request.configurations import distinct_configurations
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import FileError
from vastflow.sim.run import execute
from vastflow.tasks.keys.source import installed_tree

CAMPAIGN = """\
version: 1
configuration:
  - name: copies
    parameters:
      - word: "1"
      - map_file: maps/room.yaml
    variations:
      - plug_ins/own.py:Sizes: {}
execution:
  scenario_file: scenario.osc
  nav2_params: nav2.yaml
  run_files: ["files/*.py"]
  pre_command: files/pre.sh
evaluation:
  oracles:
    - oracle.py:Driven: {least_m: 0.1}
"""
SCENARIO = """\
import osc.helpers

scenario copies:
    word: string
    size: string = "0"
    map_file: string
    do serial:
        log(common.get_scenario_file_directory() + " to " + common.get_output_directory() + " with " + map_file)
        run_process(common.get_scenario_file_directory() + "/files/write.py " + word + size + " " + common.get_output_directory() + " " + common.get_scenario_file_directory() + "/" + map_file)
"""
PROGRAM = """\
#!/usr/bin/env python3
import os, sys
header = dict(line.split(": ", 1) for line in open(sys.argv[3]).read().splitlines() if ": " in line)
assert open(os.path.join(os.path.dirname(sys.argv[3]), header["image"]), "rb").read(2) == b"P5"
open(sys.argv[2] + "/word.csv", "w").write(f"word\\n{sys.argv[1]}{os.environ['FROM_PRE']}\\n")
"""
PRODUCER = """\
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer

class Sizes(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {"size": None}

    def produce(self, inputs, draws):
        yield Fragment({"size": "2"})
"""


@pytest.fixture
def folder(tmp_path):
    base = tmp_path / "real" / "campaign"
    files = {
        "own.vast": CAMPAIGN,
        "scenario.osc": SCENARIO,
        "files/write.py": PROGRAM,
        "files/pre.sh": "export FROM_PRE=3",
        "plug_ins/own.py": PRODUCER,
        "oracle.py": ORACLE,
        "nav2.yaml": "controller_server: {ros__parameters: {controller_frequency: 20.0}}",
        "maps/room.yaml": "image: room.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n",
    }
    for name, text in files.items():
        (base / name).parent.mkdir(parents=True, exist_ok=True)
        (base / name).write_text(text)
        (base / name).chmod(0o755)
    (base / "maps/room.pgm").write_bytes(b"P5 4 4 255\n" + bytes([254] * 16))
    return base


def spellings(base, name, links):
    """Working folder and path of every way to name a campaign file."""
    (links / "link.vast").symlink_to(base / name)
    (links / "folder").symlink_to(base)
    return {
        "absolute": (links, base / name),
        "in its folder": (base, Path(name)),
        "in its folder with a dot": (base, Path(f"./{name}")),
        "from the folder above": (base.parent, Path(base.name, name)),
        "up and down again": (base, Path("..", base.name, name)),
        "through a link to the file": (links, Path("link.vast")),
        "through a link to the folder": (links, Path("folder", name)),
        "through a link and up": (links, Path("folder", "..", base.name, name)),
    }


def asked(path):
    """The name of a campaign and the keys of its artifacts."""
    campaign, oracles = read_campaign(path)
    keys = campaign_keys(installed_tree(), campaign.seed, oracles)
    instantiation = instantiate(campaign)
    configurations = distinct_configurations(instantiation, campaign.runs)
    scenarios = [(each.name, each.scenario.digest) for each in instantiation.configurations]
    executed = [
        (configuration.name, configuration.runs, keys.recordings(configuration.checked))
        for configuration in configurations
    ]
    return configurations, (campaign_name(campaign), tuple(scenarios), tuple(executed), keys.judge_source)


def test_spellings_of_path_have_equal_keys_and_results(folder, tmp_path, monkeypatch):
    known, done = {}, {}
    for how, (here, path) in spellings(folder, "own.vast", tmp_path).items():
        monkeypatch.chdir(here)
        configurations, known[how] = asked(path)
        monkeypatch.chdir(tmp_path)  # keys were made there, runs are not
        found = execute(configurations[0].scenario, 0).recording
        words = {name: table["word"].tolist() for name, table in found.outputs.tables.items()}
        done[how] = found.run.outcome, words, sorted(set(found.behaviors["message"].tolist()))
    assert set(known.values()) == {known["absolute"]}
    assert done["absolute"][:2] == ("succeeded", {"word": [123]})
    assert all(did == done["absolute"] for did in done.values()), done


def test_faults_name_file_as_typed_and_report_circular_links(folder, monkeypatch):
    (folder / "own.vast").write_text(CAMPAIGN.replace("version: 1", "version: 9"))
    monkeypatch.chdir(folder.parent)
    with pytest.raises(FileError, match=r"^campaign/own\.vast:1:10: version: expected 1, got 9$"):
        read_campaign(Path("campaign/own.vast"))
    os.symlink("b.vast", folder / "a.vast")
    os.symlink("a.vast", folder / "b.vast")
    with pytest.raises(FileError, match="can't be read"):
        read_campaign(folder / "a.vast")
