"""The checks for producers, on producers that break the contract."""

import itertools
import random

import numpy as np
import pytest
from table import each_row

from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import CHECKS, check_producer
from vastflow.producers.model.producer import Parameters, Producer


def producer(produce, reads=("a",), writes=("b",), needs=(), tag=None, parameters=None):
    kind = type(
        "Mine",
        (Producer,),
        {
            "Parameters": Parameters,
            "reads": property(lambda self: reads),
            "needs": property(lambda self: needs),
            "writes": property(lambda self: dict.fromkeys(writes, tag)),
            "produce": lambda self, inputs, draws: iter(produce(inputs, draws)),
        },
    )
    return kind(Parameters() if parameters is None else parameters)


def fragment_of_a(inputs, draws):
    return [Fragment({"b": inputs["a"] + draws(0).random()})]


INPUTS = [{"a": 1, "z": 5}, {"a": 2, "z": 6}]


@each_row("check", [check_producer, *CHECKS])
def test_producer_that_keeps_the_contract_passes_each_check(check):
    check(producer(fragment_of_a), INPUTS)


@each_row(
    ("declared", "what"),
    [
        ({"reads": ["a"]}, r"Mine must declare `reads` as a tuple of keys, not \['a'\]"),
        ({"needs": ("map_file",)}, r"Mine must declare \['map_file'\], which it needs, in `reads`"),
        ({"writes": ("b", "_path")}, r"Mine must not declare \['_path'\] in `writes`"),
        ({"tag": "robot"}, r"Mine must tag what it writes with one of .*, not \['robot'\]"),
        ({"parameters": {"seed": 1}}, r"Mine's parameters must be a producer\.Parameters"),
    ],
)
def test_malformed_declaration_is_detected(declared, what):
    with pytest.raises(AssertionError, match=what):
        check_producer(producer(fragment_of_a, **declared), INPUTS)


@each_row("generator", [random, np.random])
def test_global_generator_is_found_even_where_it_is_seeded(generator):
    def produce(inputs, draws):
        generator.seed(inputs["a"])
        return [Fragment({"b": float(generator.random())})]

    with pytest.raises(AssertionError, match=r"Mine must not use a global generator\. Draw from `draws` alone"):
        check_producer(producer(produce), INPUTS)


def changed_input(inputs, draws):
    inputs["a"] += 1
    return [Fragment({"b": 1})]


GENERATOR, COUNT = np.random.default_rng(1), itertools.count()


@each_row(
    ("produce", "what"),
    [
        (changed_input, "Mine must not change its inputs"),
        (lambda inputs, draws: [Fragment({"b": GENERATOR.random()})], "Mine must yield the same for the same input"),
        (lambda inputs, draws: [Fragment({"b": next(COUNT)})], "Mine must yield the same for the same input"),
        (lambda inputs, draws: [Fragment({"b": inputs.get("z", 0)})], "Mine must declare 'z' in `reads`"),
        (
            lambda inputs, draws: [Fragment({"b": type(inputs).__name__})],
            "Mine must yield the same from a whole configuration",
        ),
        (lambda inputs, draws: [Fragment({"c": 1, "_note": 2})], "Mine writes 'c', which it does not declare"),
        (lambda inputs, draws: [Rejection(" ")], "Mine must say why it rejects"),
        (lambda inputs, draws: [{"b": 1}], r"Mine yields a dict\. Expected Fragment"),
        (lambda inputs, draws: [Fragment({"b": np.int64(1)})], "int64 has no canonical form"),
    ],
)
def test_broken_contract_is_found(produce, what):
    with pytest.raises((AssertionError, TypeError), match=what):
        check_producer(producer(produce), INPUTS)
