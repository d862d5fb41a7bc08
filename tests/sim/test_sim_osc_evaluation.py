"""Values of expressions at a moment of a run."""

import pickle
from pathlib import Path

import pytest
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.definition import EnumValue
from vastflow.sim.scenario.evaluation import evaluate
from vastflow.sim.scenario.language.reading import read_text


def expression(text):
    """The argument of a log."""
    body = "    p: pose_3d\n    var n: int = 0\n    f: float = 0.5\n    texts: list of string = ['a']\n"
    source = f"import osc.helpers\nimport osc.os\nscenario a:\n{body}    do log({text})\n"
    return read_text(source, "a.osc", Path())[0].root.arguments["msg"]


def value(text, functions=None, **names):
    return evaluate(expression(text), names, functions or {})


@each_row(
    ("text", "result"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("7 - 2 - 1", 4),
        ("7 / 2", 3.5),
        ("7 % 4", 3),
        ("-(2 + 1)", -3),
        ("'a' + 'b'", "ab"),
        ("2 * 3s", 6.0),
        ("1km / 500m", 2.0),
        ("1 == 1.0", True),
        ("'a' != 'b'", True),
        ("1m < 1km", True),
        ("2 <= 2", True),
        ("3 > 4", False),
        ("3 >= 4", False),
        ("2 in [1, 2]", True),
        ("3 in [1, 2]", False),
        ("true and false", False),
        ("true or false", True),
        ("not true", False),
        ("not false and false", False),
        ("signal!sigterm == signal!sigterm", True),
        ("[1m, 2m]", [1.0, 2.0]),
        ("position_2d(y: 3m)", {"x": 0.0, "y": 3.0}),
        ("signal!sigint", EnumValue("signal", "sigint", 2)),
    ],
)
def test_expression_of_constants_has_a_value(text, result):
    assert value(text) == result


def test_names_are_looked_up_when_it_is_evaluated():
    assert value("n + 1", n=4) == 5
    assert value("p.position.x", p={"position": {"x": 2.0}}) == 2.0


def test_right_side_is_looked_at_only_where_it_matters():
    assert value("false and 1 / n == 1.0", n=0) is False
    assert value("true or 1 / n == 1.0", n=0) is True


def test_functions_get_the_values_of_their_arguments():
    assert value("random.get_int(1, 2 + 3)", {"random.get_int": lambda a, b: a + b}) == 6


@each_row(
    ("text", "words"),
    [
        ("1 / n", "a.osc:8:14: '/' can't be done: "),
        ("1 % n", "a.osc:8:14: '%' can't be done: "),
        ("1.5e308 * 10.0", "a.osc:8:20: '\\*' gives a number that is too large"),
        ("p.position.x", "a.osc:8:12: p has no value"),
        ("os.abspath('a')", r"a.osc:8:12: os.abspath\(\) is not available here"),
        ("random.get_int(5, 1)", r"a.osc:8:12: random.get_int\(\) can't be done: empty range"),
    ],
)
def test_expression_without_a_value_says_where_and_why(text, words):
    def empty(a, b):
        raise ValueError("empty range")

    with pytest.raises(ScenarioError, match=words):
        value(text, {"random.get_int": empty}, n=0)


def test_evaluation_error_survives_the_way_to_another_process():
    with pytest.raises(ScenarioError, match="can't be done") as raised:
        value("1 / 0")
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)
