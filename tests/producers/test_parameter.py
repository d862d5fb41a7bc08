"""Listed and drawn values."""

import statistics
from pathlib import Path

import pytest
from families import made
from pydantic import ValidationError
from table import each_row

from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.sim.model.digest import FileContent, digest


def listed(base=Path(), **parameters):
    return made("ParameterVariationList", parameters, base)


def uniform(**parameters):
    asked = {"name": "a", "num_variations": 5, "min": 0.0, "max": 1.0, **parameters}
    return made("ParameterVariationDistributionUniform", asked)


def gaussian(**parameters):
    asked = {"name": "a", "num_variations": 5, "mean": 0.0, "std": 1.0, "seed": 3, **parameters}
    return made("ParameterVariationDistributionGaussian", asked)


def values(producer):
    return [fragment.values["a"] for fragment in evaluate(producer, {})]


def test_value_without_a_digest_is_refused():
    with pytest.raises(ValidationError, match="NaN has no digest"):
        listed(name="a", values=[float("nan")])


def test_listed_values_keep_their_order_and_their_types():
    asked = ["text", 1, 1.5, True, {"x": 1}, [1, 2]]
    assert values(listed(name="a", values=asked)) == asked
    assert [type(value) for value in values(listed(name="a", values=asked))] == [type(value) for value in asked]


def test_several_names_vary_in_lockstep():
    fragments = evaluate(listed(name=["a", "b"], values=[[1, 2], [3, 4]]), {})
    assert [fragment.values for fragment in fragments] == [{"a": 1, "b": 2}, {"a": 3, "b": 4}]


def test_listed_obstacles_belong_to_environment_under_any_key():
    boxes = [{"spawn_pose": {"position": {"x": 1.0, "y": 2.0}}, "model": "box"}]
    one = listed(name="boxes", values=[[], boxes])
    assert one.writes == {"boxes": "environment"}
    both = listed(name=["boxes", "robot_radius"], values=[[boxes, 0.2], [[], 0.3]])
    assert both.writes == {"boxes": "environment", "robot_radius": "system"}


def test_values_of_map_file_are_maps_relative_to_the_campaign_file(drawn_map):
    content = drawn_map("..", "..")
    parameters = listed(Path(content.path).parent, name="map_file", values=["map.yaml"]).parameters
    assert parameters.values == [FileContent(content.path, content.digest)]
    assert parameters.model_dump(mode="json")["values"] == [{"file": content.digest}]


def test_uniform_values_lie_between_the_bounds_and_reach_them():
    assert all(2.0 <= value <= 3.0 for value in values(uniform(min=2.0, max=3.0, num_variations=200)))
    assert set(values(uniform(min=1, max=3, type="int", num_variations=100))) == {1, 2, 3}
    assert [float(value) for value in values(uniform(type="str"))] == values(uniform())


def test_uniform_bool_is_true_with_probability_max():
    assert not any(values(uniform(max=0.0, type="bool", num_variations=50)))
    assert all(values(uniform(max=1.0, type="bool", num_variations=50)))
    assert statistics.mean(values(uniform(max=0.2, type="bool", num_variations=500))) == pytest.approx(0.2, abs=0.06)


def test_gaussian_values_have_the_mean_and_deviation_asked_for():
    drawn = values(gaussian(mean=5.0, std=2.0, num_variations=2000))
    assert statistics.mean(drawn) == pytest.approx(5.0, abs=0.2)
    assert statistics.stdev(drawn) == pytest.approx(2.0, abs=0.15)


def test_gaussian_values_are_clipped_to_bounds():
    free, clipped = values(gaussian(num_variations=100)), values(gaussian(num_variations=100, min=-0.5, max=0.5))
    assert clipped == [min(max(value, -0.5), 0.5) for value in free]


def test_gaussian_whole_numbers_are_rounded_and_bools_true_from_the_mean_upwards():
    assert values(gaussian(std=10.0, type="int")) == [round(value) for value in values(gaussian(std=10.0))]
    assert values(gaussian(std=0.0, type="bool")) == [True] * 5
    assert values(gaussian(type="bool")) == [value >= 0.0 for value in values(gaussian())]


@each_row("drawn", [uniform, gaussian])
def test_draws_depend_on_seed_and_key_and_not_on_count(drawn):
    assert values(drawn(num_variations=9))[:5] == values(drawn())
    other = [fragment.values["b"] for fragment in evaluate(drawn(name="b"), {})]
    assert other != values(drawn()) != values(drawn(seed=1))


@each_row("producer", [listed(name="a", values=[1]), uniform(), gaussian()])
def test_parameter_producers_keep_the_contract(producer):
    check_producer(producer, [{}, {"a": 3, "b": 4}])


def test_drawn_values_are_pinned():
    assert digest(values(uniform(seed=42))) == "944f18bbbdb8f995be15a6b2f74b94b0567339f30b72835b27e1a3312626656b"
    assert digest(values(gaussian(seed=42))) == "e35e49b833cdcad4ec7aaec1fdfae34d7f8c2d4285e089c63af54f7902b369ca"
