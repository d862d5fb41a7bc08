"""Campaign files as a whole: producers, maps, the flow of data, and every kind of mistake with its place."""

from collections.abc import Callable
from pathlib import Path

import pytest
from families import write_map
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.campaign import Campaign, load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.obstacle import obstacles_of

FIXED = """\
configuration:
- name: a
  parameters:
  - map_file: maps/room.yaml
  - start_pose: {x: 0.5, y: 0.5, yaw: 0.0}
  - goal_pose: {x: 1.5, y: 0.5}
"""

PAPER = """\
configuration:
- name: example
  variations:
  - FloorplanGeneration:
      floorplans:
      - environments/rooms/rooms.fpm
  - PathVariationRandom:
      num_goal_poses: 2
      path_length: 15.0
      seed: 20
  - ObstacleVariation:
      name: static_objects
      obstacle_configs:
      - amount_per_m: [0.4]
        max_distance: [0.0]
        args: width:=0.8, length:=0.8, height:=1.0
      seed: 42
"""

OWN = """\
from vastflow.producers.model import producer
from vastflow.producers.model.configuration import Fragment

class OwnParameters(producer.Parameters):
    sizes: list[int]

class Own(producer.Producer[OwnParameters]):
    Parameters = OwnParameters
    reads = ("density",)
    needs = ("density",)
    writes = {"goal_pose": None}

    def produce(self, inputs, draws):
        yield Fragment({"goal_pose": {"x": 1.0, "y": 1.0}})
"""

BOXES = """\
from vastflow.producers.model import producer
from vastflow.producers.model.configuration import Fragment

class Boxes(producer.Producer[producer.Parameters]):
    Parameters = producer.Parameters
    reads = ("count",)
    writes = {"boxes": None}

    def produce(self, inputs, draws):
        places = [{"x": 0.5 + 0.5 * k, "y": 0.5} for k in range(inputs["count"])]
        yield Fragment({"boxes": [{"spawn_pose": place, "xacro_arguments": "width:=0.2"} for place in places]})
"""

GROWTH = """\
import osc.helpers

scenario growth:
    rate: int
    label: string = "a"
    do serial:
        run_process("true")
"""
SCENARIOS = {
    "growth": GROWTH,
    "slip": GROWTH.replace("run_process", "run_proces"),
    "drawn": GROWTH.replace('string = "a"', "float = random.get_float(0.0, 1.0)"),
    "ros": GROWTH.replace("osc.helpers", "osc.ros").replace(
        'run_process("true")', 'ros_run("demo_nodes_cpp", "talker")'
    ),
    "wait": "import osc.gazebo\n\nscenario wait_for_it:\n    do serial:\n        actor_exists('box')\n",
}
PLAN = Path(__file__).with_name("test_floorplan_example.fpm").read_text()

Load = Callable[[str], Campaign]
Faults = Callable[[str], list[str]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a good map, one whose picture is missing, and a producer of one's own."""
    write_map(tmp_path / "maps", "room")
    room = (tmp_path / "maps" / "room.yaml").read_text()
    (tmp_path / "maps" / "blind.yaml").write_text(room.replace("room.pgm", "none.pgm"))
    for name, text in SCENARIOS.items():
        (tmp_path / f"{name}.osc").write_text(text)
    (tmp_path / "flat.fpm").write_text(PLAN)
    (tmp_path / "bad.fpm").write_text(PLAN.replace("width=gap", "width=gab"))
    (tmp_path / "flat.variation").write_text('import "flat.fpm"\ngap : uniform([1])')
    (tmp_path / "bad.variation").write_text('import "flat.fpm"\nwidth : uniform([1])')
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "boxes.py").write_text(BOXES)
    (tmp_path / "broken.py").write_text("import nothing_of_this_name\n")
    return tmp_path


@pytest.fixture
def load(folder: Path) -> Load:
    def load_text(text: str) -> Campaign:
        (folder / "c.vast").write_text(text)
        return load_campaign(folder / "c.vast")

    return load_text


@pytest.fixture
def faults(folder: Path, load: Load) -> Faults:
    def faults_of_text(text: str) -> list[str]:
        with pytest.raises(FileError) as caught:
            load(text)
        return [str(fault).replace(f"{folder}/", "").removeprefix("c.vast:") for fault in caught.value.faults]

    return faults_of_text


def varied(*producers: str) -> str:
    """A family with a map and these producers, the first in line 7."""
    lines = "".join(f"  - {line}\n" for line in producers)
    return f"configuration:\n- name: a\n  parameters:\n  - map_file: maps/room.yaml\n\n  variations:\n{lines}"


def test_campaign_has_families_with_values_and_producers(load: Load) -> None:
    campaign = load(
        FIXED + "  - robot_radius: 0.3\n  variations:\n"
        "  - ParameterVariationList: {name: inflation_radius, values: [0.5, 0.7]}\n"
        "execution: {runs: 5, seed: '3', timeout: 60}\nevaluation: {oracles: [safety, {performance: {x: 1}}]}\n"
    )
    (family,) = campaign.families
    assert (family.name, family.values["robot_radius"]) == ("a", 0.3)
    assert [type(producer).__name__ for producer in family.producers] == ["ParameterVariationList"]
    assert (campaign.runs, campaign.seed, campaign.timeout_s, campaign.abstract) == (5, 3, 60.0, "")
    assert {oracle.name: oracle.parameters for oracle in campaign.oracles} == {"safety": {}, "performance": {"x": 1}}
    assert (campaign.unexecutable, campaign.notes) == ((), ())


def test_lists_of_obstacles_belong_to_the_environment(load: Load) -> None:
    crates = "  - crates: [{spawn_pose: {x: 1, y: 1}, model: box}]\n"
    campaign = load(FIXED + crates + "  - color: red\n  dimensions: {color: environment}\n")
    assert campaign.families[0].dimensions == {"crates": "environment", "color": "environment"}


COUNTED_BOXES = "  variations:\n  - ParameterVariationList: {name: count, values: [0, 2, 3]}\n  - boxes.py:Boxes: {}\n"


@each_row("design", ["", "  design: {t_way: {strength: 2}}\n"])
def test_obstacles_of_an_untagged_plug_in_are_environment(load: Load, design: str) -> None:
    found = instantiate(load(FIXED.replace("x: 0.5", "x: 0.1") + COUNTED_BOXES + design)).configurations
    assert [len(obstacles_of(each.scenario.environment)) for each in found] == [0, 2, 3]
    assert ["boxes" in each.scenario.environment for each in found] == [True, True, True]
    assert not any("boxes" in each.scenario.system for each in found)


def test_constraints_and_start_check_see_obstacles_of_an_untagged_plug_in(load: Load) -> None:
    constrained = COUNTED_BOXES + "  constraints: [few: number_of_obstacles < 3]\n"
    few = instantiate(load(FIXED.replace("x: 0.5", "x: 0.1") + constrained))
    assert [len(each.scenario.environment["boxes"]) for each in few.configurations] == [0, 2]
    on_the_start = instantiate(load(FIXED + COUNTED_BOXES))
    assert [len(each.scenario.environment["boxes"]) for each in on_the_start.configurations] == [0]
    assert [each.reason.rpartition(", ")[2] for each in on_the_start.rejections] == ["into boxes[0]", "into boxes[0]"]


@each_row(
    ("lines", "notes"),
    [
        ("  scenario_file: other.osc\n", ["7:3: warning: scenario_file: 'scenario_file' has no effect in a family"]),
        ("  priority: high\n", ["7:3: unknown key: priority: 'priority' has no effect in a family"]),
        ("  - robot_color: red\n", ["7:5: unknown key: parameters[3].robot_color: unknown key 'robot_color' is ignored"]),
        (COUNTED_BOXES, ["9:5: unknown key: variations[1].boxes.py:Boxes: unknown key 'boxes' is ignored, unless it lists obstacles"]),
    ],
)  # fmt: skip
def test_idle_keys_of_a_family_are_noted(load: Load, lines: str, notes: list[str]) -> None:
    found = [note for note in load(FIXED + lines).notes if "'count'" not in note.problem]
    where = [note.place.where.removeprefix("configuration[0].") for note in found]
    said = [f"{n.place.line}:{n.place.column}: {n.kind}: {at}: {n.problem}" for n, at in zip(found, where, strict=True)]
    assert said == notes


def test_scenario_file_without_a_robot_needs_what_its_parameters_need(load: Load) -> None:
    campaign = load("configuration:\n- name: a\n  parameters:\n  - rate: 2\nexecution: {scenario_file: growth.osc}\n")
    assert (campaign.notes, campaign.unexecutable) == ((), ())
    assert isinstance(campaign.abstract, FileContent) and campaign.programs is not None


@pytest.mark.parametrize("section", ["campaign", "producers"])
def test_faults_of_a_campaign_have_place_and_message(golden, faults: Faults, section: str) -> None:
    """An input is a file, or a producer of a family with a map."""
    golden("campaign_files", section, faults if section == "campaign" else lambda line: faults(varied(line)))


@each_row("second", ["b", "a-b", "a1", "a-1x", "2d", "büro"])
def test_similar_valid_names_are_accepted(load: Load, second: str) -> None:
    other = FIXED.removeprefix("configuration:\n").replace("name: a", f"name: {second}")
    assert len(load(FIXED + other).families) == 2


def test_faults_of_a_file_are_reported_together_in_order(faults: Faults) -> None:
    found = faults(
        "version: 9\n"
        "execution: {runs: 0, runs: 2, timout: 5}\n"
        "configuration:\n"
        "- name: A\n"
        "  parameters:\n"
        "  - map_file: maps/none.yaml\n"
        "  - start_pose: here\n"
        "  variations:\n"
        "  - Unknown: {}\n"
        "  - PathVariationRandom: {path_length: 0, sed: 1}\n"
        "- name: b\n"
        "  parameters:\n"
        "  - map_file: maps/blind.yaml\n"
        "evaluation: {oracle: []}\n"
    )
    places = "1:10 2:19 2:22 2:31 4:9 6:15 7:17 9:5 10:40 10:43 11:9 13:15 14:14"
    assert [complaint.split(": ")[0] for complaint in found] == places.split()


WORDS = st.sampled_from(
    [
        "", " ", "\n", "\n  - ", "- ", ": ", "{", "}", "[", "]", "&a ", "*a", "<<: *a", "null", "yes", "1e3", ".nan", "'@x'", '"\\0"',
        "0x" + "f" * 30, "-1", "!!set ", "!x ", "name", "map_file", "goal_poses", "start_pose", "values", "PathVariationRandom", "own.py:Own",
        "OneOfVariation", "variations", "configuration", "execution", "seed", "ä", "#", "|", "%",
    ]
)  # fmt: skip
SEEDS = (
    PAPER,
    FIXED + "  variations:\n  - ParameterVariationList: {name: [a, robot_radius], values: [[1, 0.2], [2, 0.3]]}\n"
    "  - ParameterVariationDistributionUniform: {name: b, num_variations: 2, min: 0, max: 1}\n"
    "  - OneOfVariation: {variations: [{ParameterVariationList: {name: map_file, values: [maps/room.yaml]}}]}\n"
    "execution: {runs: 2, resources: {cpu: [{a: 1}]}, secondary_containers: [x], env: [{A: 1}]}\n"
    "evaluation: {oracles: [safety], visualization: [{T: {run: r}}]}\nsearch:\n",
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    text=st.sampled_from(SEEDS),
    edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), WORDS), min_size=1, max_size=4),
)
def test_mutated_file_is_a_campaign_or_a_campaign_error(
    load: Load, text: str, edits: list[tuple[float, int, str]]
) -> None:
    for share, length, word in edits:
        at = round(share * len(text))
        text = text[:at] + word + text[at + length :]
    try:
        campaign = load(text)
    except FileError as error:
        assert error.faults
        assert all(fault.place.line >= 1 and fault.place.column >= 1 and fault.problem for fault in error.faults)
    else:
        assert campaign.families or campaign.spec.search
