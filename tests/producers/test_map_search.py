"""Maps and files beside a campaign file, and in a folder that the user names."""

import shutil
from pathlib import Path

import pytest
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.campaign_file.scenario import run_files
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.places.ground import MapSearch
from vastflow.sim.model.faults import FileError
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.world import world_content

CAMPAIGN = """\
configuration:
  - name: room
    parameters:
      - map_file: halls/map.yaml
    variations:
      - PathVariationRandom: {path_length: 1.0, path_length_tolerance: 0.3, robot_diameter: 0.2, min_distance: 0.1}
  - name: rooms
    variations:
      - ParameterVariationList: {name: map_file, values: [halls/map.yaml, beside.yaml]}
      - PathVariationRandom: {path_length: 1.0, path_length_tolerance: 0.3, robot_diameter: 0.2, min_distance: 0.1}
      - OneOfVariation:
          variations:
            - ObstacleVariation: {map_file: halls/map.yaml, obstacle_configs: [{amount: 0, max_distance: 0.1}]}
"""


@pytest.fixture
def places(tmp_path, drawn_map):
    """A campaign file whose maps lie partly beside it, and the folder of the others."""
    one, other = drawn_map(*["." * 40] * 40), drawn_map(*["." * 50] * 30)
    base, maps = tmp_path / "campaign", tmp_path / "maps"
    (maps / "halls").mkdir(parents=True)
    base.mkdir()
    for content, folder, name in ((one, maps / "halls", "map"), (other, base, "beside")):
        source = Path(content.path)
        shutil.copy(source.with_suffix(".pgm"), folder / f"{name}.pgm")
        (folder / f"{name}.yaml").write_text(source.read_text().replace("map.pgm", f"{name}.pgm"))
    (base / "two.vast").write_text(CAMPAIGN)
    return base, maps


def test_map_beside_campaign_file_has_precedence_over_map_dir(places):
    base, maps = places
    shutil.copytree(maps / "halls", base / "halls")
    search = MapSearch(base, maps)
    assert search.content("halls/map.yaml").path == str(base / "halls" / "map.yaml")
    assert search.borrowed == {}


@each_row(
    ("name", "folder", "said"),
    [
        ("hall/map.yaml", "maps", r"hall/map\.yaml: No such file, and no .*\. Did you mean 'halls/map\.yaml'\?"),
        ("/opt/other.yaml", "maps", r"/opt/other\.yaml: No such file, and no .*maps/other\.yaml\. Expected "),
        ("map.yaml", "empty", r"empty' has no map"),
    ],
)
def test_missing_map_names_both_places_and_nearest_map(places, name, folder, said):
    base, maps = places
    with pytest.raises(WorldError, match=said):
        MapSearch(base, maps.parent / folder).content(name)


@pytest.mark.parametrize("name", ["halls/map.yaml", "/opt/share/halls/map.yaml", "/halls/map.yaml"])
def test_folder_of_maps_is_searched_by_the_longest_end_of_a_path(places, name):
    base, maps = places
    shutil.copy(base / "beside.yaml", maps / "map.yaml")
    search = MapSearch(base, maps)
    found = search.content(name)
    assert found.path == str(maps / "halls" / "map.yaml")
    assert search.borrowed == {found.path: name}


def test_folder_of_maps_is_in_no_digest(places):
    base, maps = places
    campaign = load_campaign(base / "two.vast", maps)
    assert set(campaign.borrowed_maps.values()) == {"halls/map.yaml"}
    apart = instantiate(campaign)
    shutil.copytree(maps / "halls", base / "halls")
    beside = instantiate(load_campaign(base / "two.vast"))
    assert apart.configurations
    assert [c.scenario.digest for c in apart.configurations] == [c.scenario.digest for c in beside.configurations]


# Files that a campaign gives its programs: never copies that campaigns left beside it

LEFT = {
    "a campaign directory": ("campaign.vast", "metadata.json"),
    "an export": ("_config/campaign.vast",),
}


@pytest.fixture
def files(tmp_path):
    (tmp_path / "tools").mkdir()
    for name in ("drive.sh", "tools/drive.sh", "metadata.json"):
        (tmp_path / name).write_text(name)
    return tmp_path


def names(files, *patterns):
    return [path for path, _ in run_files(files, patterns)]


@pytest.mark.parametrize("marks", LEFT.values(), ids=LEFT)
@pytest.mark.parametrize("pattern", ["drive.sh", "**", "*/**/*.sh"])
def test_campaign_leaves_input_files_unchanged(files, marks, pattern):
    before = names(files, pattern)
    left = files / "results" / "drive-2026-11-22-030000"
    for name in (*marks, "inputs/drive.sh", "inputs/tools/drive.sh"):
        (left / name).parent.mkdir(parents=True, exist_ok=True)
        (left / name).write_text(name)
    assert names(files, pattern) == before != []


def test_user_folder_may_be_named_results(files):
    (files / "results").mkdir()
    (files / "results" / "expected.csv").write_text("1")
    assert names(files, "*.csv") == ["results/expected.csv"]


def test_campaign_file_beside_a_file_of_facts_is_still_the_campaigns_own_folder(files):
    (files / "campaign.vast").write_text("version: 1")
    assert "tools/drive.sh" in names(files, "drive.sh")


def test_world_of_family_is_read_beside_campaign_file(places):
    base, maps = places
    (base / "posts.csv").write_text("0.2,0.2,0.1\n")
    text = CAMPAIGN.replace(
        "      - map_file: halls/map.yaml\n", "      - map_file: halls/map.yaml\n      - world: posts.csv\n", 1
    )
    (base / "two.vast").write_text(text)
    campaign = load_campaign(base / "two.vast", map_dir=maps)
    found = campaign.families[0].values["world"]
    assert (Path(found.path).name, found.digest) == ("posts.csv", world_content(base / "posts.csv").digest)
    varied = "      - ParameterVariationList: {name: world, values: [posts.csv]}\n"
    (base / "two.vast").write_text(CAMPAIGN.replace("    variations:\n", f"    variations:\n{varied}", 1))
    (producer, *_) = load_campaign(base / "two.vast", map_dir=maps).families[0].producers
    assert producer.parameters.values == [found]
    (base / "two.vast").write_text(text)
    (base / "posts.csv").write_text("0.2,0.2,much\n")
    with pytest.raises(FileError, match=r"5:16: .*posts\.csv:1: expected three numbers x, y, radius"):
        load_campaign(base / "two.vast", map_dir=maps)
    (base / "two.vast").write_text(text.replace("posts.csv", "3"))
    with pytest.raises(FileError, match=r"5:16: .*world: expected the path of a world, or a mapping of seed"):
        load_campaign(base / "two.vast", map_dir=maps)
