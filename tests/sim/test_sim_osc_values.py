"""Values of names and expressions: globals, members, defaults, variables, and operators at a moment of a run."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.reading.abstract import abstract_content, definition_of
from vastflow.sim.scenario.definition import EnumValue
from vastflow.sim.scenario.evaluation import evaluate
from vastflow.sim.scenario.language.parameters import bound
from vastflow.sim.scenario.language.reading import read_text
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.tree import ScenarioTree

HEAD = "import osc.helpers\nimport osc.gazebo\nimport osc.nav2\nimport osc.ros\n"


def read(body, before=""):
    lines = "".join(f"    {line}\n" for line in body.strip("\n").split("\n"))
    return read_text(f"{HEAD}{before}scenario visit:\n{lines}", "visit.osc", Path())[0]


def logged(body, before="", **overrides):
    """The lines that a scenario logs until it ends, well."""
    lines: list[str] = []
    definition = read(body, before)
    functions = helper_functions(np.random.default_rng(0), Path("/scenarios"), Path("/out"))
    tree = ScenarioTree(definition, bound(definition, overrides), HELPERS, functions, log=lines.append)
    for _ in range(100):
        if not tree.ended:
            tree.tick()
    assert tree.passed, tree.reason.message
    return lines


def test_scenario_logs_values_of_its_names(golden):
    """Declarations stand above a line `scenario:`."""

    def lines(text):
        before, _, body = text.rpartition("scenario:\n")
        return logged(body, before)

    golden("scenarios", "logs", lines, key="lines")


def test_derived_values_follow_given_values():
    assert logged("p: string = q + '!'\nq: string = 'x'\ndo log(p)", q="y") == ["y!"]
    assert logged("v: box\ndo log(v.h)", "struct box:\n    f: int = 3\n    h: int = f + 1\n", v={"f": 7}) == ["8"]


def test_custom_action_inherits_behavior_and_overrides_defaults():
    before = (
        "global dock: pose_3d = pose_3d(position_3d(x: 2.0m))\n"
        "action differential_drive_robot.go_home inherits differential_drive_robot.nav_to_pose:\n"
        "    goal_pose: pose_3d = dock\n"
        "action cheer inherits log:\n    keep(it.msg == 'done')\n"
        "action sigh inherits log:\n    msg: string = 'alas'\n"
    )
    root = read("bot: differential_drive_robot\ndo bot.go_home()", before).root
    assert root.action == "differential_drive_robot.nav_to_pose"
    assert root.arguments["goal_pose"].path == ("dock",)
    assert logged("do serial:\n    cheer()\n    cheer('again')\n    sigh()", before) == ["done", "again", "alas"]


def test_scenario_that_no_other_inherits_from_is_run(tmp_path):
    file = tmp_path / "trial.osc"
    base = f"{HEAD}scenario base:\n    p: string = 'a'\n    do log(p)\n"
    file.write_text(f"{base}scenario derived inherits base:\n    p: string = 'b'\n")
    derived = definition_of(abstract_content(file))
    assert (derived.name, bound(derived, {})) == ("derived", {"p": "b"})
    file.write_text(f"{base}scenario other:\n    do log('x')\n")
    with pytest.raises(ScenarioError, match="expected one scenario to run, got base, other"):
        abstract_content(file)


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
        ("1 + 2 * 3 - 7 % 4 - 1", 3),
        ("-(1 + 2) * 3 / 2", -4.5),
        ("1km / 500m", 2.0),
        ("1 == 1.0 and 'a' + 'b' != 'b' and 1m < 1km and 2 <= 2", True),
        ("3 > 4 or 3 >= 4", False),
        ("2 in [1, 2]", True),
        ("not false and 3 in [1, 2]", False),
        ("false and 1 / n == 1.0", False),
        ("true or 1 / n == 1.0", True),
        ("n + 1", 1),
        ("p.position.x", 2.0),
        ("[1m, 2m]", [1.0, 2.0]),
        ("position_2d(y: 3m)", {"x": 0.0, "y": 3.0}),
        ("signal!sigint", EnumValue("signal", "sigint", 2)),
    ],
)
def test_expression_has_a_value(text, result):
    assert value(text, n=0, p={"position": {"x": 2.0}}) == result


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
def test_expression_without_value_reports_place_and_reason(text, words):
    def empty(a, b):
        raise ValueError("empty range")

    with pytest.raises(ScenarioError, match=words) as raised:
        value(text, {"random.get_int": empty}, n=0)
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)
