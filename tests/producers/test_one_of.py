"""Alternatives."""

from pathlib import Path

from families import made

from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate

LIST = {"ParameterVariationList": {"name": "a", "values": [1, 2]}}
UNIFORM = {"ParameterVariationDistributionUniform": {"name": "b", "num_variations": 3, "min": 0, "max": 1, "seed": 7}}
OBSTACLES = {"ObstacleVariation": {"obstacle_configs": [{"amount": 1, "max_distance": 0.3}]}}


def one_of(*children, base=Path(), **others):
    return made("OneOfVariation", {"variations": list(children), **others}, base)


def test_alternatives_yield_each_child_as_alone_in_order():
    uniform, listed = (evaluate(made(*next(iter(child.items()))), {}) for child in (UNIFORM, LIST))
    assert evaluate(one_of(UNIFORM, LIST), {}) == uniform + listed
    nested = one_of({"OneOfVariation": {"variations": [LIST]}}, LIST)
    assert evaluate(nested, {}) == [Fragment({"a": value}) for value in (1, 2, 1, 2)]


def test_alternatives_declare_reads_and_writes_of_children():
    producer = one_of(LIST, OBSTACLES)
    assert producer.writes == {"a": "system", "static_objects": "environment"}
    assert producer.needs == ("map_file",)
    assert "_path" in producer.reads
    assert one_of(LIST, OBSTACLES, dimension="task").writes == {"a": "task", "static_objects": "task"}


def test_alternatives_rejection_names_child():
    (rejection,) = evaluate(one_of(OBSTACLES), {"map_file": "x"})
    assert isinstance(rejection, Rejection)
    assert rejection.reason.startswith("ObstacleVariation: ")


def test_child_may_be_a_class_of_a_file_beside_the_campaign(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from vastflow.producers.catalog.parameter import ParameterVariationList\n\n\n"
        "class Mine(ParameterVariationList):\n    pass\n"
    )
    producer = one_of({"mine.py:Mine": {"name": "c", "values": [1]}}, base=tmp_path)
    assert evaluate(producer, {}) == [Fragment({"c": 1})]


def test_alternatives_keep_the_contract():
    check_producer(one_of(LIST, UNIFORM), [{}, {"z": 1}])


def test_parameters_can_be_written_down_with_their_childrens():
    written = one_of(LIST).parameters.model_dump(mode="json")
    assert written["variations"] == [{"ParameterVariationList": {"dimension": None, **LIST["ParameterVariationList"]}}]
