"""`vastflow benchmark`: the same scenes for every Nav2 file, and where one loses."""

import json
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import called, refused
from judged_directory import write
from packed_barn import packed
from table import each_row

from vastflow.flows.analysis.benchmark import benchmark_text, scenes_text
from vastflow.flows.analysis.comparison import compared
from vastflow.flows.cli.benchmark import write_campaign
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.terminal.markdown import write_markdown
from vastflow.oracles.results.tables import read_tables
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.system.system import system_of

NAV2 = Path(__file__).parents[2] / "campaigns" / "nav2"
SCENES = {"office": 12, "doors": 10, "crossings": 24, "s-turn": 6, "open-hall": 4}


def instantiated(folder, nav2_params, barn=None):
    campaign, _ = read_campaign(write_campaign(folder, "controller", nav2_params, barn))
    assert campaign.unexecutable == ()
    return instantiate(campaign)


def scene_of(name):
    return re.sub(r"(-\d+)+$", "", name)


def test_benchmark_gives_every_file_the_same_situations(tmp_path):
    found = [instantiated(tmp_path / name, NAV2 / name) for name in ("jazzy_mppi.yaml", "dwb.yaml")]
    (first, second) = ({c.name: c.scenario for c in each.configurations} for each in found)
    assert not any(each.rejections for each in found)
    assert {scene: sum(scene_of(name) == scene for name in first) for scene in map(scene_of, first)} == SCENES
    assert first.keys() == second.keys()
    for name, scenario in first.items():
        assert (scenario.environment, scenario.task) == (second[name].environment, second[name].task)


def test_robot_with_a_map_drives_barn_without_it_and_other_scenes_with_it(tmp_path):
    data = packed(tmp_path / "data", range(0, 300, 6))
    found = instantiated(tmp_path / "benchmark", NAV2 / "dwb.yaml", data)
    without = {scene_of(c.name) for c in found.configurations if not system_of(c.scenario.system).needs_map}
    with_map = {scene_of(c.name) for c in found.configurations if system_of(c.scenario.system).needs_map}
    assert (without, with_map) == ({"barn"}, {*SCENES})


def test_benchmark_refuses_three_files_and_rounds_of_one(tmp_path):
    files = [word for name in ("a", "b", "c") for word in ("--params", tmp_path / name)]
    assert refused("benchmark", *files) == "--params: expected one file or two, got 3"
    assert refused("benchmark", *files[:2], "--until-decided") == "--until-decided: requires a second --params"


def directory(folder, **scenes):
    """Return a directory with a configuration for each scene.

    Letters are runs: f failed, c had a contact, p passed in 10 s, and s passed in 20 s.
    """
    written = write(
        folder,
        {
            name: (k, folder.name, re.sub("[cs]", lambda m: {"c": "f", "s": "p"}[m[0]], said))
            for k, (name, said) in enumerate(scenes.items())
        },
        oracles=("success", "safety"),
    )
    for table in ("configurations", "verdicts"):
        rows = pq.read_table(file := written / f"{table}.parquet")
        changed = rows.to_pylist()
        for row in changed:
            row["family"] = name = row.get("configuration") or row["name"]
            if table == "verdicts":
                letter = scenes[name][row["run_index"]]
                time_s, contacts = 20.0 if letter == "s" else 10.0, float(letter == "c")
                own = ("time", time_s, "s") if row["oracle"] == "success" else ("contacts", contacts, "1")
                row["metrics"] = json.dumps({own[0]: {"value": own[1], "unit": own[2]}})
                touched_but_there = letter == "c" and row["oracle"] == "success"
                row["judgment"] = "pass" if touched_but_there else row["judgment"]
        pq.write_table(pa.Table.from_pylist(changed, rows.schema), file)
    return read_tables(written)


def shown(rows, tmp_path):
    write_markdown(rows, tmp_path / "shown.md")
    return (tmp_path / "shown.md").read_text()


def test_table_has_rates_contacts_and_times_by_scene(tmp_path):
    text = shown(benchmark_text(directory(tmp_path / "a", doors="pppppppssc", hall="p" * 10)), tmp_path)
    assert "| doors | 10 | 90.0 % | 59.5 to 98.3 | 1 | 12.2 s | 8.8 to 15.6 |" in text.replace("\xa0", " ")
    assert "all runs end alike, so at most their times tell controllers apart: hall\n" in text


@each_row(
    "after, sentence",
    [
        (("p" * 20, "f" * 20), "B passes fewer runs in doors (100.0 points)"),
        (("p" * 20, "c" * 20), "B passes fewer runs in doors (100.0 points)"),
        (("s" * 20, "p" * 20), "B takes longer in hall (10.0 s)"),
        (("p" * 20, "p" * 20), "no difference in passing or time is shown in any scene"),
        (("p" * 20, "p" * 18 + "ff"), "no difference in passing or time is shown in any scene"),
    ],
)
def test_sentence_names_scene_in_which_one_loses(after, sentence, tmp_path):
    before = directory(tmp_path / "a", hall="p" * 20, doors="p" * 20)
    found = compared(before, directory(tmp_path / "b", hall=after[0], doors=after[1]))
    assert shown(scenes_text(found), tmp_path).rstrip().splitlines()[-1] == sentence


@each_row(("lost", "others", "claimed"), [(6, 0, False), (7, 0, True), (7, 3, False)])
def test_claimed_loss_holds_beside_all_other_intervals(lost, others, claimed, tmp_path):
    """Six of twenty exclude 0 in one interval, seven in two, and neither in eight."""
    calm = {f"hall-{k}": "p" * 20 for k in range(others)}
    before = directory(tmp_path / "a", doors="p" * 20, **calm)
    found = compared(before, directory(tmp_path / "b", doors="p" * (20 - lost) + "f" * lost, **calm))
    assert ("B passes fewer runs in doors" in shown(scenes_text(found), tmp_path)) == claimed


def test_times_are_not_claimed_if_rounds_ended_early(tmp_path):
    tables = directory(tmp_path / "a", hall="p" * 20), directory(tmp_path / "b", hall="s" * 20)
    text = shown(scenes_text(compared(*tables, until_decided=True)), tmp_path)
    assert "no difference in passing or time is shown" in text
    assert "| hall | 20 | 10.0 | 20.0 | \\+10.0 |  |" in text


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.usefixtures("flow_folder")
def test_benchmark_names_the_slower_of_two_controllers(tmp_path):
    text = (NAV2 / "jazzy_mppi.yaml").read_text()
    (tmp_path / "slow.yaml").write_text(text.replace("vx_max: 0.5", "vx_max: 0.25"))
    places = ("--store", tmp_path / "store", "--results", tmp_path / "results", "--out", tmp_path / "benchmark")
    asked = ("--only", "open-hall", "--runs", 2, "--params", NAV2 / "jazzy_mppi.yaml")
    for other, options, runs, said in (
        (tmp_path / "slow.yaml", (), 8, "B takes longer in open-hall"),
        (NAV2 / "jazzy_mppi.yaml", (), 8, "no difference in passing or time is shown in any scene"),
        (NAV2 / "jazzy_mppi.yaml", ("--until-decided",), 4, "decided after 1 of 2 rounds: nothing changed"),
    ):
        done = called("benchmark", *asked, "--params", other, *options, *places)
        assert done.exit_code == 0, done.output
        assert "BARN is not run" in done.stdout
        assert re.search(rf"open-hall +{runs} +100.0 %", done.stdout)
        assert said in done.stdout
