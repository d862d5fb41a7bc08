"""Families whose files are not there: which faults are theirs alone, and which are the whole file's."""

import pytest
from families import write_map
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.sim.model.faults import FileError

HERE = "map_file: room.yaml"


@pytest.fixture
def loaded(tmp_path):
    """A campaign of two families with these parameters beside their poses, the second with these variations too."""
    write_map(tmp_path, rows=40)
    (tmp_path / "no-picture.yaml").write_text("{image: gone.pgm, resolution: 0.05, origin: [0, 0, 0]}")
    (tmp_path / "no-map.yaml").write_text("[]")
    (tmp_path / "no-plan.variation").write_text('import "gone.fpm"\nwidth : uniform([1.0, 2.0])\n')

    def load(parameters=HERE, variations="", first=HERE, poses="start_pose: {x: 1, y: 1}, goal_pose: {x: 1.5, y: 1}"):
        (tmp_path / "x.vast").write_text(f"""\
version: 1
configuration:
  - name: one
    parameters: [{first}, {poses}]
  - name: two
    parameters: [{", ".join(filter(None, [parameters, poses]))}]
    variations: [{variations}]
""")
        return load_campaign(tmp_path / "x.vast")

    return load


PLANS = "{name: [map_file, mesh_file], %s}"
PATHS = "{start_pose: '@start_pose', goal_poses: '@goal_pose', path_length: 1, num_paths: 1, robot_diameter: 0.3, map_file: gone.yaml}"


@each_row(
    ("family", "what"),
    [
        ({"parameters": "map_file: gone.yaml"}, "/gone.yaml: No such file"),
        ({"parameters": "map_file: /opt/ros/maps/depot.yaml"}, "/opt/ros/maps/depot.yaml: No such file"),
        ({"parameters": "map_file: no-picture.yaml"}, "image: There is no file '"),
        ({"variations": f"PathVariationRandom: {PATHS}"}, "/gone.yaml: No such file"),
        ({"variations": f"OneOfVariation: {{variations: [PathVariationRandom: {PATHS}]}}"}, "/gone.yaml: No such file"),
        ({"parameters": "", "variations": f"FloorplanGeneration: {PLANS % 'floorplans: [gone.fpm]'}"}, "gone.fpm:1:1: No such file"),
        ({"parameters": "", "variations": f"FloorplanVariation: {PLANS % 'variation_files: [gone.variation]'}"}, "gone.variation:1:1: No such file"),
        ({"parameters": "", "variations": f"FloorplanVariation: {PLANS % 'variation_files: [no-plan.variation]'}"}, "gone.fpm': No such file"),
    ],
)  # fmt: skip
def test_family_with_missing_file_is_unavailable_with_fault(loaded, family, what):
    campaign = loaded(**family)
    assert [each.name for each in campaign.families] == ["one"]
    (fault,) = campaign.unavailable["two"]
    assert what in str(fault)
    assert (fault.place.line, fault.kind == "missing") == (6 if "variations" not in family else 7, True)


@each_row(
    ("families", "faults"),
    [
        ({"parameters": "map_file: gone.yaml", "first": "map_file: lost.yaml"}, ["lost.yaml", "gone.yaml"]),
        ({"parameters": "map_file: gone.yaml, robot_radius: 30"}, ["gone.yaml", "got 30"]),
        ({"parameters": "map_file: no-map.yaml"}, ["expected a mapping with image"]),
    ],
)
def test_file_without_a_family_left_is_refused_with_all_faults(loaded, families, faults):
    with pytest.raises(FileError, match=r"x\.vast") as refused:
        loaded(**families)
    assert len(refused.value.faults) == len(faults)
    for fault, said in zip(refused.value.faults, faults, strict=True):
        assert said in str(fault)
