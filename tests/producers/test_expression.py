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
        ("2 ** 900 + 1 > 2 ** 900", True),
    ],
)
def test_expression_is_true_or_false_as_it_reads(text, expected):
    assert holds(text, VALUES | {"inner": 5, "insider": 1, "orbit": False, "notable": False} | KEYWORDS) is expected


def complaints(text):
    with pytest.raises((FileError, NotEvaluable)) as caught:
        holds(text)
    return [str(fault).removeprefix(":1:") for fault in getattr(caught.value, "faults", [caught.value])]


@pytest.mark.parametrize("section", ["expressions", "evaluations"])
def test_fault_of_an_expression_has_column_and_message_or_the_reason(golden, section):
    golden("campaign_files", section, complaints)


@each_row(
    ("text", "message"),
    [
        ("not " * 70 + "fast", "More than 60 levels deep"),
        ("(" * 70 + "1 < 2" + ")" * 70, "More than 60 levels deep"),
        ("- " * 900 + "1 > 0", "More than 60 levels deep"),
        ("1 < " + "1 + " * MOST_CHARACTERS + "1", "More than 2000 characters"),
        ("not\ud800", "got '.ud800'"),
    ],
)
def test_expression_is_refused_when_too_long_or_deep(text, message):
    with pytest.raises(FileError, match=message):
        expression_of(text)


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
def test_constraint_expression_has_python_semantics(text):
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


def test_any_text_is_parsed_or_refused_quickly(loops):
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


def test_expression_does_not_grow_without_end(loops):
    text = "9" + " ** 9" * 50 + " > " + " * ".join(["9" * 250] * 6)

    def refused():
        with pytest.raises(NotEvaluable, match="too large"):
            holds(text)

    assert loops(refused) < 10
