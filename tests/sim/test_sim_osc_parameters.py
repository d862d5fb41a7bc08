"""Values of parameters: defaults, and what a configuration gives in their place."""

import pickle
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.scenario.definition import EnumValue
from vastflow.sim.scenario.language.parameters import ParameterMismatch, bound, default_of
from vastflow.sim.scenario.language.reading import read_text


def scenario(*parameters):
    body = "".join(f"    {parameter}\n" for parameter in parameters)
    text = f"import osc.helpers\nimport osc.ros\nimport osc.gazebo\nscenario patrol:\n{body}    do log('x')\n"
    (definition,) = read_text(text, "patrol.osc", Path())
    return definition


def value(parameter, **overrides):
    """The value of a scenario's only parameter."""
    (found,) = bound(scenario(parameter), overrides).values()
    return found


def test_parameters_have_their_defaults_in_order():
    values = bound(scenario("b: speed = 3mps", "a: position_2d = position_2d(y: 1m)", "c: list of int = [1, 2]"), {})
    assert list(values.items()) == [("b", 3.0), ("a", {"x": 0.0, "y": 1.0}), ("c", [1, 2])]


@each_row(
    ("parameter", "given", "value_"),
    [
        ("p: string", "maps/flat.yaml", "maps/flat.yaml"),
        ("p: string", 0.5, "0.5"),
        ("p: string", True, "true"),
        ("p: float", 3, 3.0),
        ("p: uint", 3, 3),
        ("p: bool", False, False),
        ("p: speed", 1, 1.0),
        ("p: time = 10s", 2.5, 2.5),
        ("p: signal", "sigint", EnumValue("signal", "sigint", 2)),
        ("p: signal", "signal!sigint", EnumValue("signal", "sigint", 2)),
        ("p: signal", EnumValue("signal", "sigint", 2), EnumValue("signal", "sigint", 2)),
        ("p: float", "3.5", 3.5),
        ("p: int", "-3", -3),
        ("p: speed", "0.8", 0.8),
        ("p: list of string", [1, "a"], ["1", "a"]),
        ("p: list of int = [1, 2, 3]", [], []),
        ("p: list of int", (1, 2), [1, 2]),
    ],
)
def test_parameter_override_replaces_default(parameter, given, value_):
    found = value(parameter, p=given)
    assert found == value_ and type(found) is type(value_)


def test_faults_of_values_have_place_and_message(golden):
    """An input declares a parameter in its first line and gives a value in YAML below it."""

    def faults(text):
        parameter, _, given = text.partition("\n")
        with pytest.raises(ParameterMismatch, match="of scenario patrol: ") as raised:
            bound(scenario(parameter), yaml.safe_load(given) if given else {})
        assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)
        return [str(raised.value)]

    golden("scenarios", "values", faults)


def test_part_of_a_struct_leaves_the_other_members_as_the_default_has_them():
    pose = value("p: pose_3d = pose_3d(position_3d(1m, 2m))", p={"position": {"x": 9}})
    assert pose["position"] == {"x": 9.0, "y": 2.0, "z": 0.0}


def test_member_of_a_struct_without_default_is_given():
    pose = {"position": {"x": 2.0}}
    (box,) = value("p: list of spawn_entity", p=[{"entity_name": "box1", "spawn_pose": pose, "model": "box.sdf"}])
    assert (box["model"], box["xacro_arguments"], box["spawn_pose"]["position"]["x"]) == ("box.sdf", "", 2.0)


def test_number_with_a_unit_is_given_in_the_unit_of_the_default():
    assert value("p: speed = 36.0kmph", p=72.0) == pytest.approx(20.0)
    assert value("p: temperature = 20C", p=10) == pytest.approx(283.15)


def test_default_may_call_a_function():
    definition = scenario("p: string = common.get_output_directory()")
    assert bound(definition, {}, {"common.get_output_directory": lambda: "/out"}) == {"p": "/out"}
    assert default_of(definition, "p") is None


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(-(2**53), 2**53))
def test_numbers_survive_round_trip(x, n):
    values = bound(scenario("x: float", "n: int", "d: length"), {"x": x, "n": n, "d": x})
    assert values == {"x": x, "n": n, "d": x}


def test_overrides_and_defaults_are_not_shared_between_runs():
    definition, overrides = scenario("p: pose_3d = pose_3d()"), {"p": {"position": {"x": 1}}}
    bound(definition, overrides)["p"]["position"]["x"] = 5.0
    assert bound(definition, overrides)["p"]["position"]["x"] == 1.0
    assert overrides == {"p": {"position": {"x": 1}}}


def test_binding_takes_far_less_than_a_millisecond_of_cpu(loops):
    definition = scenario("start: pose_3d", "goals: list of pose_3d", "limit: speed = 1mps")
    overrides = {"start": {"position": {"x": 1.0}}, "goals": [{"position": {"x": 1.0}}] * 3}
    assert loops(lambda: [bound(definition, overrides) for _ in range(50)]) / 50 < 0.05
