"""Constraints: the values they read, the configurations they exclude, and their faults."""

import pytest
from families import Campaign, family, grown, levels, made, write_map
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.campaign_file.sections import CARTESIAN, DesignSpec, Sample, TWay
from vastflow.producers.constraints.constraint import place_inside
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import FileError

T_WAY = DesignSpec(t_way=TWay(strength=2))
SAMPLE = DesignSpec(sample=Sample(method="random", size=1000))
ROOM = {"goal_pose": {"x": 5.0, "y": 3.0}, "start_pose": {"x": 1.0, "y": 3.0, "yaw": 0.0}}


@pytest.fixture(scope="module")
def room(drawn_map):
    """A room of 6 m × 6 m from (-1, -2) on, with a wall in between."""
    return drawn_map(
        "#" * 14, *["#" + "." * 12 + "#"] * 5, "####...#######", *["#" + "." * 12 + "#"] * 6, "#" * 14, cells=10
    )


@each_row("design", [CARTESIAN, T_WAY, SAMPLE])
def test_constraints_filter_configurations(design):
    found = grown(levels("a", 1, 2, 3), levels("b", 1, 2, 3), design=design, ordered="a < b", small="a + b < 5")
    assert [(c.factors["a"], c.factors["b"]) for c in found.configurations] == [(1, 2), (1, 3)]
    assert [c.name for c in found.configurations] == ["rooms-1-2", "rooms-1-3"]


def test_exclusions_name_the_constraint_and_its_values():
    found = grown(levels("a", 1, 2), levels("b", 5, 6), other="a != 1 or b != 6", small="a < 2")
    assert [(e.family, e.name, e.constraint, e.values) for e in found.excluded] == [
        ("rooms", "rooms-2", "small", {"a": 2}),
        ("rooms", "rooms-1-2", "other", {"a": 1, "b": 6}),
    ]
    assert found.coverage["excluded_by"] == {"small": 1, "other": 1}
    assert [found.coverage[name] for name in ("requested", "excluded", "realized")] == [3, 2, 1]


def test_overwritten_key_is_checked_at_end():
    found = grown(levels("b", 1), values={"b": 9}, small="b < 5")
    assert len(found.configurations) == 1


def test_values_inside_of_poses_and_lists_can_be_named(room):
    values = {**ROOM, "map_file": room, "goal_poses": [{"x": 2.0, "y": 1.0}], "local.radius": 0.3}
    text = "goal_pose.x > start_pose.x and goal_poses[0].y == 1 and local.radius < 1 and `local.radius` > 0"
    assert len(grown(values=values, where=text).configurations) == 1


def test_quantities_of_drawn_path_match_producer(room):
    path = made("PathVariationRandom", {"path_length": [3, 4], "goal_poses": "@goal_pose", "num_paths": 2})
    found = grown(path, values={"map_file": room}, long="path_length > 3.5")
    assert [round(c.provenance["_path_length"]) for c in found.configurations] == [4, 4]
    assert all(e.values["path_length"] < 3.5 for e in found.excluded)
    assert len(found.excluded) == 2


def looked(room, name, **values):
    """The value of a quantity: what a constraint that nothing keeps looked at."""
    with_all = {**ROOM, "map_file": room, **values}
    apart = family(name="apart", values={"x": 1})
    tags = {"boxes": "environment"}
    found = instantiate(Campaign((apart, family(values=with_all, dimensions=tags, never=f"{name} < -1"))))
    return found.excluded[0].values[name]


@each_row(
    ("start", "goal", "quantities"),
    [
        # The lower half of the room is free from x = -0.5 to 5.5 and from y = -1.5 to 1.5.
        ((0.0, -1.0), (4.0, -1.2), {"start_clearance": 0.5, "goal_clearance": 0.3, "clearance": 0.3}),
        # The door is three letters of 0.5 m wide, and the straight path goes through its middle.
        ((1.75, -0.5), (1.75, 3.5), {"narrowest_passage": 1.5, "straight_distance": 4.0, "path_length": 4.0}),
        ((0.0, 0.0), (3.0, 0.0), {"number_of_goals": 1, "number_of_obstacles": 3, "obstacle_density": 1.0}),
    ],
)
def test_quantities_describe_path_and_obstacles(room, start, goal, quantities):
    poses = {key: {"x": x, "y": y} for key, (x, y) in (("start_pose", start), ("goal_pose", goal))}
    boxes = [{"spawn_pose": {"x": 1, "y": 1}}] * 3
    for name, value in quantities.items():
        assert looked(room, name, boxes=boxes, **poses) == pytest.approx(value, abs=0.06)


def test_constraint_on_obstacles_waits_for_their_producer(room):
    kinds = [{"amount_per_m": [0.0, 0.5], "max_distance": 1.0, "model": "box", "xacro_arguments": "width:=0.2"}]
    obstacles = made("ObstacleVariation", {"obstacle_configs": kinds})
    for design in (CARTESIAN, T_WAY):
        found = grown(
            obstacles,
            levels("noise", 0, 1),
            values={**ROOM, "map_file": room, "start_pose": {"x": 0.0, "y": 0.0}, "goal_pose": {"x": 4.0, "y": 0.0}},
            design=design,
            some="number_of_obstacles > 0",
        )
        assert [c.name for c in found.configurations] == ["rooms-2-1", "rooms-2-2"]
        assert len(found.excluded) == 1


@each_row("design", [CARTESIAN, T_WAY])
def test_constraint_that_can_not_be_evaluated_is_a_fault(design):
    with pytest.raises(FileError, match="Constraint 'odd' can't be evaluated for rooms-2: text < a number"):
        grown(levels("a", 1, "two"), levels("b", 1, 2), design=design, odd="a < 3")


def test_name_that_only_some_alternatives_write_has_to_be_guarded():
    either = made(
        "OneOfVariation", {"variations": [{"ParameterVariationList": {"name": n, "values": [1, 2]}} for n in "ab"]}
    )
    with pytest.raises(FileError, match="rooms-3: it has no 'a'"):
        grown(either, small="a < 2")
    assert len(grown(either, small="defined(a) implies a < 2").configurations) == 3


def test_path_length_needs_a_path(room):
    with pytest.raises(FileError, match="path_length: the configuration has no path"):
        grown(values={"map_file": room}, long="path_length > 1")


def test_unsatisfiable_constraints_are_one_fault_with_counts():
    with pytest.raises(FileError) as raised:
        grown(levels("a", 1, 2, 3), low="a < 2", high="a > 2")
    (fault,) = raised.value.faults
    assert fault.problem == "the constraints leave nothing of family 'rooms': low excludes 2, high excludes 1"


def test_empty_family_does_not_stop_others():
    lost = family(levels("a", 1, 2), never="a > 5")
    found = instantiate(Campaign((lost, family(levels("a", 1), name="other"))))
    assert [c.name for c in found.configurations] == ["other-1"]
    assert found.coverage["families"]["rooms"]["excluded_by"] == {"never": 2}


FILE = """version: 1
{top}configuration:
  - name: rooms
    parameters: [robot_radius: 0.2, start_pose: {{x: 0.0, y: 0.0}}, goal_pose: {{x: 3.0, y: 0.0}}, map_file: room.yaml]
    variations:
      - ParameterVariationList: {{name: gain, values: [1, 2, 3]}}
{constraints}"""


@pytest.fixture
def load(tmp_path):
    cells = bytes(0 if x in (0, 99) or y in (0, 99) else 254 for y in range(100) for x in range(100))
    write_map(tmp_path, "room", 100, 100, (-1, -1), cells)

    def load_text(constraints, top=""):
        (tmp_path / "x.vast").write_text(FILE.format(constraints=constraints, top=top))
        return load_campaign(tmp_path / "x.vast")

    return load_text


def faults_of(load, constraints):
    with pytest.raises(FileError) as raised:
        load(constraints)
    return list(map(str, raised.value.faults))


def test_constraints_are_read_from_lists_mappings_and_the_campaign(load):
    listed = load(
        "    constraints:\n      - small: gain < 3\n      - narrow: robot_radius < 0.3\n",
        "constraints: {all: gain > 0}\n",
    )
    mapped = load("    constraints: {small: gain < 3, narrow: robot_radius < 0.3}\n")
    assert [c.name for c in listed.families[0].constraints] == ["all", "small", "narrow"]
    assert [c.name for c in mapped.families[0].constraints] == ["small", "narrow"]
    assert [c.factors["gain"] for c in instantiate(listed).configurations] == [1, 2]


def test_faults_of_constraints_and_designs_have_place_and_message(golden, load, tmp_path):
    def faults(text):
        return [each.replace(f"{tmp_path}/", "") for each in faults_of(load, text)]

    golden("campaign_files", "constraints", faults)


def test_place_inside_of_a_double_quoted_text_counts_its_escapes():
    source = 'a: "x \\"y\\" = 3"'
    assert place_inside(source, (1, 4), 'x "y" = 3', 6) == (1, 13)
    assert source[12] == "="


def test_design_is_read_from_the_file(load):
    assert load("    design: {t_way: {strength: 3}}\n").families[0].design == DesignSpec(t_way=TWay(strength=3))
    assert load("    design: {sample: {method: lhs, size: 2}}\n").families[0].design.sample.size == 2
    assert load("    design: cartesian\n").families[0].design == CARTESIAN


def test_design_reports_fault_at_its_place_when_too_large(load):
    variations = "".join(
        f"      - ParameterVariationList: {{name: k{i}, values: [1, 2, 3, 4, 5, 6, 7, 8, 9]}}\n" for i in range(7)
    )
    tied = " + ".join(f"k{i}" for i in range(7))
    campaign = load(f"{variations}    constraints: [all: {tied} > 0]\n    design: {{t_way: {{}}}}\n")
    with pytest.raises(FileError, match=r"15:5: configuration\[0\].design: The design of family 'rooms' is too large"):
        instantiate(campaign)
