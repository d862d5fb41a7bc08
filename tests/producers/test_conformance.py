"""The checks for producers, on producers that break the contract."""

import itertools

import numpy as np
import pytest

from vastflow.producers.configuration import Fragment, Rejection
from vastflow.producers.conformance import check_producer
from vastflow.producers.producer import Parameters, Producer


def producer(produce, reads=("a",), writes=("b",)):
    kind = type(
        "Mine",
        (Producer,),
        {
            "Parameters": Parameters,
            "reads": property(lambda self: reads),
            "writes": property(lambda self: dict.fromkeys(writes)),
            "produce": lambda self, inputs, draws: iter(produce(inputs, draws)),
        },
    )
    return kind(Parameters())


INPUTS = [{"a": 1, "z": 5}, {"a": 2, "z": 6}]


def test_a_producer_that_keeps_the_contract_passes():
    check_producer(producer(lambda inputs, draws: [Fragment({"b": inputs["a"] + draws(0).random()})]), INPUTS)


def test_a_global_generator_is_found():
    generator = np.random.default_rng(1)
    with pytest.raises(AssertionError, match="Mine must yield the same for the same input"):
        check_producer(producer(lambda inputs, draws: [Fragment({"b": generator.random()})]), INPUTS)


def test_state_between_inputs_is_found():
    count = itertools.count()
    with pytest.raises(AssertionError, match="Mine must yield the same for the same input"):
        check_producer(producer(lambda inputs, draws: [Fragment({"b": next(count)})]), INPUTS)


def test_an_undeclared_read_is_found():
    with pytest.raises(AssertionError, match="Mine must declare 'z' in `reads`"):
        check_producer(producer(lambda inputs, draws: [Fragment({"b": inputs.get("z", 0)})]), INPUTS)


def test_an_undeclared_key_is_found():
    with pytest.raises(AssertionError, match=r"Mine must declare \['c'\] in `writes`"):
        check_producer(producer(lambda inputs, draws: [Fragment({"c": 1, "_note": 2})]), INPUTS)


def test_a_rejection_without_a_reason_is_found():
    with pytest.raises(AssertionError, match="Mine must say why it rejects"):
        check_producer(producer(lambda inputs, draws: [Rejection(" ")]), INPUTS)


def test_something_else_than_a_fragment_is_found():
    with pytest.raises(AssertionError, match="Mine must yield Fragment or Rejection, not dict"):
        check_producer(producer(lambda inputs, draws: [{"b": 1}]), INPUTS)


def test_a_value_without_a_digest_is_found():
    with pytest.raises(TypeError, match="int64 has no canonical form"):
        check_producer(producer(lambda inputs, draws: [Fragment({"b": np.int64(1)})]), INPUTS)
