"""What of a configuration is asked to explain its outcome."""

from types import SimpleNamespace

from table import each_row

from vastflow.oracles.evidence.varied import varied_rows

MAP = "ab" * 32


def rows(factors, provenance):
    table = SimpleNamespace(factors=[{}, factors], provenances=[{}, provenance])
    return varied_rows(table, [1], {MAP: "office"})


def test_a_map_is_called_by_its_name_and_another_file_by_the_beginning_of_its_digest():
    other = {"file": "cd" * 32}
    assert rows({"map_file": {"file": MAP}, "mesh": other}, {}) == [{"map_file": "office", "mesh": "cdcdcdcd"}]


def test_the_length_of_the_path_is_a_factor_to_the_centimeter():
    assert rows({"noise": 0.1}, {"_path_length": 5.031370849898476}) == [{"noise": 0.1, "path length (m)": 5.03}]


@each_row("value", [None, 0.0, "long"])
def test_without_a_length_there_is_no_such_factor(value):
    assert rows({}, {"_path_length": value}) == [{}]


def test_a_drawn_world_is_told_by_its_numbers_of_which_0_is_a_level():
    noted = {"_wall_offset_m": 0.1, "_missing_furniture": 0.0}
    drawn = {"noise": 0.1, "world": {"seed": 5, "wall_offset": 0.1}}
    said = {"noise": 0.1, "wall offset (m)": 0.1, "missing furniture": 0.0}
    assert rows(drawn, noted) == [said]
    assert rows({"noise": 0.1}, noted | {"_wall_offset_m": 0.0}) == [said | {"wall offset (m)": 0.0}]


def test_a_world_that_the_file_gives_stays_what_it_is():
    assert rows({"world": {"seed": 5}}, {}) == [{"world": {"seed": 5}}]
