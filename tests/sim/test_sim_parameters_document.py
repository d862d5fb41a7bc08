"""Nav2 parameter files as documents: paths, places, and what can be wrong with a file as such."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.model.files import MOST_LEVELS
from vastflow.sim.nav2.parameter_files.document import parse, read_document
from vastflow.sim.nav2.parameter_files.interpretation import interpretation


def values(text):
    return parse(text).values


def fault(text):
    with pytest.raises(FileError) as caught:
        parse(text, "nav2.yaml")
    return str(caught.value)


def test_path_leads_through_node_and_groups_to_each_value():
    assert values("a:\n  ros__parameters: {b: {c: 1, d: [x, 2.0]}, e: true}") == {
        ("a", "ros__parameters", "b", "c"): 1,
        ("a", "ros__parameters", "b", "d"): ["x", 2.0],
        ("a", "ros__parameters", "e"): True,
    }


@each_row(
    ("written", "nested"),
    [
        ("a: {ros__parameters: {B.c: 1}}", "a: {ros__parameters: {B: {c: 1}}}"),
        ("/a/b: {ros__parameters: {c: 1}}", "a: {b: {ros__parameters: {c: 1}}}"),
        ("a/b: {ros__parameters: {c: 1}}", "a: {b: {ros__parameters: {c: 1}}}"),
    ],
)
def test_dotted_parameters_and_slashed_nodes_are_nested_ones(written, nested):
    assert values(written) == values(nested)


def test_csv_values_have_apparent_types():
    text = "a: {ros__parameters: {i: 1, f: 1.0, e: 1e-3, p: 1.0e-10, t: on, s: '1', d: 2024-01-01, n: , inf: .inf}}"
    found = list(values(text).values())
    assert found == [1, 1.0, 0.001, 1e-10, True, "1", "2024-01-01", None, float("inf")]
    assert list(map(type, found[:3])) == [int, float, float]


@each_row(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("1E3", 1000.0),
        ("y", True),
        ("N", False),
        ("'y'", "y"),
        ("off", False),
        ("inf", float("inf")),
        ("-Infinity", -float("inf")),
        ("08", 8.0),
        ("010", 8),
        ("0x10", 16),
        ("0o10", "0o10"),
        ("'0.5'", "0.5"),
        ("!!str 5", "5"),
        ("9223372036854775807", 9223372036854775807),
        ("9223372036854775808", 9223372036854775808.0),
        ("1e400", "1e400"),
        ("1e-400", "1e-400"),
        ("0e400", 0.0),
        ("2024-01-01", "2024-01-01"),
    ],
)
def test_values_are_read_as_ros_2_parses_what_launch_files_write(text, value):
    (found,) = values(f"a: {{ros__parameters: {{b: {text}}}}}").values()
    assert (found, type(found)) == (value, type(value))


def test_second_document_is_refused_as_by_nav2s_launch_files():
    assert "2:1: expected one document, as Nav2's launch files take no more, got a second YAML document" in fault(
        "a: {ros__parameters: {b: 1}}\n---\na: {ros__parameters: {b: 2}}"
    )
    assert values("---\na: {ros__parameters: {b: 1}}\n...\n")


@each_row(
    ("text", "repeated"),
    [
        ("a: {ros__parameters: {b: 1}}\na: {ros__parameters: {c: 1}}", [("a",)]),
        ("a: {ros__parameters: {g: {b: 1}, g: {c: 1}}}", [("a", "ros__parameters", "g")]),
        ("/a: {ros__parameters: {b: 1}}\na: {ros__parameters: {c: 1}}", []),
        ("a: {ros__parameters: {g: &g {b: 1}, <<: {g: *g}}}", []),
    ],
)
def test_group_that_a_mapping_has_twice_is_noted(text, repeated):
    document = parse(text)
    assert [path for path in document.repeated if path not in document.values] == repeated


def test_aliases_and_merges_are_resolved_and_own_keys_win():
    found = values("x: {ros__parameters: &x {b: 1, c: {d: 1}}}\ny: {ros__parameters: {<<: *x, b: 2}}")
    assert {path[2:]: value for path, value in found.items() if path[0] == "y"} == {("b",): 2, ("c", "d"): 1}


def test_values_have_places():
    document = parse("a:\n  ros__parameters:\n    b: 1\n    c:\n      - x\n      - y\n")
    place = document.place
    assert place(("a", "ros__parameters", "b")) == (3, 8)
    assert place(("a", "ros__parameters", "c")) == (4, 5)
    assert place(("a", "ros__parameters", "c", "1")) == (6, 9)
    assert place(("a", "ros__parameters", "unknown")) == (2, 3)


def test_last_of_two_equal_parameters_counts():
    document = parse("a: {ros__parameters: {b: 1}}\nc: {ros__parameters: {d: 1}}\na: {ros__parameters: {b: 2, e: 1}}")
    assert document.values[("a", "ros__parameters", "b")] == 2
    assert document.repeated == (("a",), ("a", "ros__parameters", "b"))
    assert document.place(("a", "ros__parameters", "b")) == (3, 26)


def test_parameter_node_is_found_in_namespace():
    empty = parse("a: {ros__parameters: }\nb: {ros__parameters: {c: 1}}")
    assert set(empty.nodes) == {("b", "ros__parameters"), ("a", "ros__parameters")}
    document = parse("x: {a: {ros__parameters: {p: 1}}}\na: {ros__parameters: {p: 1}}\nros__parameters: {p: 1}")
    assert document.node("a") == ("a", "ros__parameters")
    assert document.node("x", "a") == ("x", "a", "ros__parameters")
    assert document.node("b") is None


def test_faults_of_a_parameter_document_have_place_and_message(golden):
    golden("nav2_parameters", "document", lambda text: fault(text).splitlines())


def test_aliases_that_grow_without_bound_are_a_fault():
    doubling = "".join(f"x{k}: &x{k} {{a: *x{k - 1}, b: *x{k - 1}}}\n" for k in range(1, 40))
    assert "Aliases grow" in fault(f"x0: &x0 {{ros__parameters: {{b: 1}}}}\n{doubling}")


def test_aliases_may_not_exceed_maximum_depth():
    chain = "".join(f"x{k}: &x{k} {{a: *x{k - 1}}}\n" for k in range(1, 2 * MOST_LEVELS))
    assert "levels. Use fewer aliases" in fault(f"x0: &x0 {{a: {{ros__parameters: {{b: 1}}}}}}\n{chain}")


def test_missing_or_binary_file_is_a_fault_of_the_whole(tmp_path):
    (tmp_path / "latin.yaml").write_bytes(b"a:\n b: \xe4\n")
    messages = {"none.yaml": "No such file", ".": "It is a folder", "latin.yaml": "2:5: Byte 0xe4 is not UTF-8"}
    for name, message in messages.items():
        with pytest.raises(FileError, match=message):
            read_document(tmp_path / name)


def test_error_is_pickled():
    with pytest.raises(FileError) as caught:
        parse("a: 1", "nav2.yaml")
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@given(st.text(alphabet="ab:{}[]-&*!|>'\"\n #,0.~<_", max_size=60))
def test_any_text_is_a_document_or_has_faults(text):
    try:
        document = parse(f"n: {{ros__parameters: {{p: 1}}}}\n{text}")
    except FileError as error:
        assert error.faults
    else:
        assert document.values


@each_row(
    ("text", "value"),
    [
        ("$(env SPEED 0.3)", 0.3),
        ("$(env SPEED 3)", 3),
        ("$(optenv ON true)", True),
        ("$(env SPEED 1e-3)", 0.001),
        ("'$(env SPEED 0.3)'", "0.3"),
        ("$(env NAME '')/scan", "/scan"),
        ("$(env A a)_$(env B b)", "a_b"),
        ("[$(env A 1.0), 2.0]", [1.0, 2.0]),
        ("$(env SPEED)", "$(env SPEED)"),
        ("$(var speed)", "$(var speed)"),
        ("$(find-pkg-share my_bot)/bt.xml", "$(find-pkg-share my_bot)/bt.xml"),
    ],
)
def test_substitution_of_a_launch_file_is_its_default(monkeypatch, text, value):
    monkeypatch.setenv("SPEED", "9.0")  # this machine's is not the robot's
    (found,) = parse(f"amcl: {{ros__parameters: {{alpha1: {text}}}}}").values.values()
    assert (found, type(found)) == (value, type(value))


@each_row("text", ["$(env SPEED)", "$(var speed)", "$(eval 1.0 + 2.0)"])
def test_substitution_without_default_is_an_error_that_says_what_to_do(text):
    with pytest.raises(
        FileError, match=r"alpha1: The launch file replaces .* Write what it puts there, a number, or \$\(env"
    ):
        interpretation(parse(f"amcl: {{ros__parameters: {{alpha1: {text}}}}}"))
