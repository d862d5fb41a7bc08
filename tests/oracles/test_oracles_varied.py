"""What of a configuration is asked to explain its outcome."""

from types import SimpleNamespace

import pyarrow as pa

from vastflow.oracles.evidence.varied import chosen_rows, matched_sets, varied_rows

MAP = "ab" * 32


def table_of(*configurations):
    """Of factors, provenance, the keys that each step wrote, and the content of the scenario."""
    factors, provenances, steps, contents = zip(*configurations, strict=True)
    return SimpleNamespace(
        factors=factors,
        provenances=provenances,
        steps=[[{"keys": keys} for keys in each] for each in steps],
        contents=contents,
        table=pa.table({"abstract": ["builtin:navigate_to_pose"] * len(factors)}),
    )


def rows(factors, provenance, *steps):
    return chosen_rows(table_of((factors, provenance, steps, {})), [0], {MAP: "office"})


def with_boxes(per_m, radius, draw, boxes, start=0.0):
    """A configuration with a path and boxes near it, as producers write it."""
    pose = {"x": start, "y": 0.0}
    noted = {"_requested_start_pose": {"path_length": 6.0}, "_requested_boxes": {"amount_per_m": per_m, "draw": draw}}
    given = {"start_pose": pose, "boxes": boxes, "robot_radius": radius}
    steps = (["start_pose", "_requested_start_pose"], ["boxes", "_requested_boxes"], ["robot_radius"])
    content = {"environment": {"boxes": boxes}, "task": {"start_pose": pose}, "system": {"robot_radius": radius}}
    return given, noted, steps, content


def test_drawn_values_are_told_by_what_was_requested():
    assert chosen_rows(table_of(with_boxes(0.6, 0.2, 1, [{"x": 1.0}])), [0], {}) == [
        {"path_length": 6.0, "amount_per_m": 0.6, "robot_radius": 0.2}
    ]


def test_matched_sets_are_equal_in_all_but_the_factor_and_what_it_places():
    one, two = [{"x": 1.0}], [{"x": 1.0}, {"x": 2.0}]
    table = table_of(
        with_boxes(0.6, 0.2, 1, one), with_boxes(0.9, 0.2, 1, two), with_boxes(0.6, 0.3, 1, one),
        with_boxes(0.9, 0.2, 2, two[:1]), with_boxes(0.6, 0.2, 1, one, start=1.0),
    )  # fmt: skip
    assert matched_sets(table, range(5), "amount_per_m").tolist() == [0, 0, 1, 2, 3]
    assert matched_sets(table, range(5), "robot_radius").tolist() == [0, 1, 0, 2, 3]
    assert len(set(matched_sets(table, [0, 4], "path_length").tolist())) == 2  # poses differ


def test_map_is_called_by_its_name_and_another_file_by_the_beginning_of_its_digest():
    other = {"file": "cd" * 32}
    assert rows({"map_file": {"file": MAP}, "mesh": other}, {}) == [{"map_file": "office", "mesh": "cdcdcdcd"}]


def test_drawn_length_of_a_path_is_no_factor():
    assert rows({"noise": 0.1}, {"_path_length": 5.031370849898476}) == [{"noise": 0.1}]
    table = table_of(({"noise": 0.1}, {"_path_length": 5.031370849898476}, (), {}))
    assert varied_rows(table, [0], {}) == [{"noise": 0.1, "path length (m)": 5.03}]


def test_drawn_world_is_told_by_its_numbers_of_which_0_is_a_level():
    noted = {"_wall_offset_m": 0.1, "_missing_furniture": 0.0}
    drawn = {"noise": 0.1, "world": {"seed": 5, "wall_offset": 0.1}}
    said = {"noise": 0.1, "wall offset (m)": 0.1, "missing furniture": 0.0}
    assert rows(drawn, noted) == [said]
    assert rows({"noise": 0.1}, noted | {"_wall_offset_m": 0.0}) == [said | {"wall offset (m)": 0.0}]


def test_world_that_the_file_gives_stays_what_it_is():
    assert rows({"world": {"seed": 5}}, {}) == [{"world": {"seed": 5}}]
