"""The language of constraints."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.constraints.expression import MOST_CHARACTERS, NotEvaluable, expression_of
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import FileError

VALUES = {
    "radius": 0.2,
    "width": 1.5,
    "loops": 3,
    "controller": "mppi",
    "fast": True,
    "sizes": [1, 2.5],
    "map_file": FileContent("/somewhere/maps/rooms.yaml", "d"),
}

KEYWORDS = {"lambda": 1, "is.class[0]": 1, "None": True}


def holds(text, values=VALUES):
    def look(name):
        if name.text not in values:
            raise NotEvaluable(f"no {name.text}")
        return values[name.text]

    return expression_of(text).holds(look)


@each_row(
    ("text", "expected"),
    [
        ("width >= 2 * radius + 0.1", True),
        ("not (width > 1 and radius > 0.3)", True),
        ("1 < loops <= 3 < width + 2", True),
        ("1 < loops < 3", False),
        ("controller == 'mppi' implies fast", True),
        ("controller != 'mppi' implies 1 / 0 > 1", True),
        ("false implies false implies false", True),
        ("not fast or loops % 2 == 1", True),
        ("-2 ** 2 == -4 and 2 ** -1 == 0.5 and 2 ** 3 ** 2 == 512", True),
        ("controller in ['dwb', 'rpp']", False),
        ("controller not in ['dwb', 'rpp']", True),
        ("2.5 in sizes and len(sizes) == 2 and max(sizes) == 2.5", True),
        ("abs(-radius) == min(radius, 1) and sqrt(4) == 2 and round(radius) == 0", True),
        ('map_file == "maps/rooms.yaml" and map_file != "other.yaml"', True),
        ("map_file in ['office.yaml', 'rooms.yaml']", True),
        ("defined(radius) and not defined(nothing)", True),
        ("`radius` < 1 and inner < 2 or true", True),
        ("insider == 1 or orbit or notable", True),
        ("lambda < 2 and is.class[0] == 1 and None", True),
    ],
)
def test_expression_is_true_or_false_as_it_reads(text, expected):
    assert holds(text, VALUES | {"inner": 5, "insider": 1, "orbit": False, "notable": False} | KEYWORDS) is expected


@each_row(
    ("text", "offset", "message"),
    [
        ("", 0, "expected an expression .*, got nothing"),
        ("radius = 3", 7, "expected '==' to compare, got '='"),
        ("radius > 1 && fast", 11, "expected 'and', got '&&'"),
        ("radius >", 8, "ends too early; a number"),
        ("(radius > 1", 11, r"ends too early; .*'\)'"),
        ("radius > 1)", 10, r"got '\)'"),
        ("root(radius) > 1", 0, "no function 'root'; known: abs"),
        ("sqrt(1, 2) > 1", 0, "sqrt of 2 values; sqrt of 1"),
        ("sqrt('a') > 1", 5, "sqrt of text; a number"),
        ("1 < radius + 'a'", 11, r"expected numbers on both sides, got a value \+ text"),
        ("'a' > 3", 4, "expected values of one kind, got text > a number"),
        ("radius + 1", 0, "the whole is a number; a comparison"),
        ("3 and fast", 0, "expected true or false, got a number"),
        ("not 3", 4, "expected true or false, got a number"),
        ("radius in 3", 10, "expected a list after .*, got a number"),
        ("radius < [1]", 7, "'<' of a list; 'in'"),
        ("3m > 1", 0, "got '3m'"),
        ("x > 1e999", 4, "expected a number below 1e300, got 1e999"),
        ("not " * 70 + "fast", 36, "more than 60 levels deep"),
        ("(" * 70 + "1 < 2" + ")" * 70, 10, "more than 60 levels deep"),
        ("1 < " + "1 + " * MOST_CHARACTERS + "1", MOST_CHARACTERS, "characters; at most 2000"),
        ("defined(1 + 2)", 0, "expected defined of one name, got 'defined' of something else"),
        ("radius if fast else loops", 7, "expected an operator .*, got 'if'"),
        ("lambda: 1", 6, "got ':'"),
        ("radius is fast", 7, "expected an operator .*, got 'is'"),
        ("max(*sizes) > 1", 4, r"got '\*sizes\)'"),
        ("[x for x in sizes] == 1", 1, "expected an operator .*, got 'x'"),
        ("radius.__class__() == 1", 0, "got 'radius.__class__"),
        ("- " * 900 + "1 > 0", 60, "more than 60 levels deep"),
        ("not\ud800", 3, "got '.ud800'"),
    ],
)
def test_what_is_wrong_with_a_text_is_told_with_its_place(text, offset, message):
    with pytest.raises(FileError, match=message) as raised:
        expression_of(text)
    assert raised.value.faults[0].place.column - 1 >= offset
    if offset < 30:
        assert raised.value.faults[0].place.column - 1 == offset or "deep" in message


@each_row(
    ("text", "message"),
    [
        ("controller > 3", "text > a number"),
        ("controller == 3", "text == a number"),
        ("fast == 1", "true or false == a number"),
        ("radius in ['a']", "a number == text"),
        ("radius and fast", "'and' of a number 0.2"),
        ("fast + 1 > 1", r"true or false \+ a number"),
        ("radius", "the whole is a number"),
        ("1 / (loops - 3) > 1", "'/' by zero"),
        ("loops % 0 == 1", "'%' by zero"),
        ("9 ** 9 ** 9 ** loops > 1", r"the result of '\*\*' is too large"),
        ("1e200 * 1e200 > 1", r"the result of '\*' is too large"),
        ("(-1) ** 0.5 > 1", "no real number"),
        ("sqrt(-width) > 1", "sqrt of -1.5"),
        ("round(1, -1000000000) > 1", "round to -1000000000 digits"),
        ("sizes == 2", "a list == a number"),
        ("missing > 1", "no missing"),
        ("len(radius) > 1", "len of a number"),
        ("min(sizes) > controller", "a number > text"),
    ],
)
def test_what_can_not_be_evaluated_is_neither_true_nor_false(text, message):
    with pytest.raises(NotEvaluable, match=message):
        holds(text)


def test_names_are_listed_once_with_what_they_can_mean():
    names = expression_of("goal_pose.x > `a b` and goal_poses[1].y < goal_pose.x").names
    assert [(name.text, name.offset) for name in names] == [("goal_pose.x", 0), ("a b", 14), ("goal_poses[1].y", 24)]
    assert names[0].readings == (("goal_pose.x", ()), ("goal_pose", ("x",)))
    assert names[2].readings == (("goal_poses", (1, "y")),)


numbers = st.one_of(
    st.integers(0, 50).map(str),
    st.floats(0, 100, allow_nan=False).map(lambda x: f"{x:.3f}"),
    st.sampled_from(["a", "b"]),
)


def binary(children, operators):
    return st.tuples(children, st.sampled_from(operators), children).map(" ".join)


arithmetic = st.recursive(
    numbers,
    lambda inner: st.one_of(
        binary(inner, ["+", "-", "*", "/", "%"]),
        inner.map(lambda x: f"({x})"),
        inner.map(lambda x: f"-{x}"),
        inner.map(lambda x: f"abs({x})"),
        st.lists(inner, min_size=2, max_size=3).map(lambda xs: f"max({', '.join(xs)})"),
        st.tuples(inner, st.integers(0, 3)).map(lambda x: f"({x[0]}) ** {x[1]}"),
    ),
    max_leaves=8,
)
comparison = st.one_of(
    binary(arithmetic, ["<", "<=", "==", "!=", ">", ">="]),
    st.tuples(arithmetic, arithmetic, arithmetic).map(lambda x: f"{x[0]} < {x[1]} <= {x[2]}"),
    st.tuples(arithmetic, st.lists(arithmetic, max_size=3)).map(lambda x: f"{x[0]} in [{', '.join(x[1])}]"),
)
truths = st.recursive(
    comparison,
    lambda inner: st.one_of(
        binary(inner, ["and", "or"]), inner.map(lambda x: f"({x})"), inner.map(lambda x: f"not {x}")
    ),
    max_leaves=6,
)


@settings(deadline=None, max_examples=60)
@given(truths)
def test_expression_means_what_it_means_in_python(text):
    values = {"a": 3, "b": 0.25}
    try:
        expected = eval(text, {"__builtins__": {}, "abs": abs, "max": max}, values)
    except (ZeroDivisionError, OverflowError):
        expected = None
    try:
        found = holds(text, values)
    except NotEvaluable:
        return  # stricter than Python where a number is infinite or has too many digits
    except FileError as fault:
        assert "deep" in str(fault) or "characters" in str(fault)
        return
    assert found == expected


PIECES = ["a", "b.c", "1", "2.5", "'t'", '"u"', "(", ")", "[", "]", ",", "+", "-", "*", "**", "/", "%", "<", "==", "!=",
          " and ", " or ", " not ", " in ", " implies ", "true", "max(", "sqrt(", "`k`", "9999999", "é", "=", "\\", "\n", "0x1", "\0"]  # fmt: skip


def test_any_text_is_an_expression_or_a_fault_and_takes_no_time(loops):
    chance = random.Random(1)
    outcomes = set()

    def outcome():
        text = "".join(chance.choice(PIECES) for _ in range(chance.randint(1, 25)))
        try:
            outcomes.add(type(holds(text, {"a": 9**99, "b.c": -1.5, "k": "t"})))
        except (FileError, NotEvaluable) as error:
            outcomes.add(type(error))
            assert str(error)

    assert loops(lambda: [outcome() for _ in range(4000)], 1) < 60
    assert outcomes == {bool, FileError, NotEvaluable}


def test_no_expression_grows_without_end(loops):
    text = "9" + " ** 9" * 50 + " > " + " * ".join(["9" * 250] * 6)

    def refused():
        with pytest.raises(NotEvaluable, match="too large"):
            holds(text)

    assert loops(refused) < 10


def test_large_whole_number_is_still_exact():
    assert holds("2 ** 900 + 1 > 2 ** 900")
