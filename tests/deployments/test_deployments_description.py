"""Needs of containers by a campaign's `execution`, and amounts of memory in the units of Kubernetes."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.model.names import label_of
from vastflow.tasks.prefect.containers import (
    Containers,
    Needs,
    kubernetes_memory,
    memory_bytes,
)


def faults(described, execution, context=None):
    with pytest.raises(FileError, match=r"rooms\.vast:\d+:\d+: execution") as error:
        described(execution, context)
    return [str(fault).partition("rooms.vast:")[2] for fault in error.value.faults]


def test_containers_have_every_key(described):
    assert described() == Containers(
        name="two-rooms",
        needs=Needs(cpu=4, memory_bytes=8 * 2**30, gpu=1),
        env={"FOO": "1", "COST": "$HOME $(FOO) $$x 'q'"},
        node_labels={"disk": "ssd", "example.org/fast": "true"},
    )
    assert described("  runs: 1\n") == Containers("two-rooms")


LISTS = "  resources:\n    memory: [{b: 2Gi}, {a: 1Gi}]\n    cpu: [{a: 1}, {b: 2}]\n"


@each_row(
    ("resources", "context", "needs"),
    [
        (
            "  resources:\n    cpu: [{edge: 4}, {cloud: 16}]\n    memory: [{edge: 8Gi}, {cloud: 1.5G}]\n",
            None,
            (4, 2**33),
        ),
        (
            "  resources:\n    cpu: [{edge: 4}, {cloud: 16}]\n    memory: [{edge: 8Gi}, {cloud: 1.5G}]\n",
            "cloud",
            (16, 1_500_000_000),
        ),
        (LISTS, None, (1, 2**30)),
        ("  resources: {cpu: 3}\n", "any", (3,)),
    ],
)
def test_resources_belong_to_chosen_or_first_cluster(described, resources, context, needs):
    assert described(resources, context).needs == Needs(*needs)


def test_containers_refuse_impossible_values(described, golden, tmp_path):
    def faults_of(execution):
        context = "edg" if "[{edge: 4}]" in execution else None
        return [fault.replace(str(tmp_path), "HERE") for fault in faults(described, execution, context)]

    golden("execution", "containers", faults_of)


@each_row(
    ("written", "text"),
    [("1", "1"), ("1.10", "1.10"), ("yes", "yes"), ("1e3", "1e3"), ("'a b'", "a b"), ("", ""), ("010", "010")],
)
def test_variable_has_value_as_it_is_written(described, written, text):
    assert described(f"  env:\n    - NAME: {written}\n").env == {"NAME": text}
    assert described("  env:\n    - A: &on true\n    - B: *on\n").env == {"A": "true", "B": "true"}


@each_row("text", ["Nav Stack", "_nav_", "x" * 62 + "-y", "Ä1", "nav"])
def test_label_is_made_of_any_name_with_letter_or_digit(text):
    assert re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?", label_of(text))


@each_row(
    ("text", "size"),
    [
        ("8Gi", 8 * 2**30),
        ("512Mi", 512 * 2**20),
        ("64Ki", 64 * 2**10),
        ("1.5Gi", 3 * 2**29),
        ("1G", 10**9),
        ("2k", 2000),
        ("123", 123),
        (".5Ki", 512),
        ("0.3", 1),
    ],
)
def test_memory_bytes_reads_quantity_of_kubernetes(text, size):
    assert memory_bytes(text) == size


@each_row(
    ("text", "right"),
    [
        ("8GB", "Did you mean '8Gi'?"),
        ("8g", "Did you mean '8Gi'?"),
        ("8 Gi", "Did you mean '8Gi'?"),
        ("512m", "Did you mean '512Mi'?"),
        ("lots", "more than 0, such as 8Gi"),
        ("-1Gi", "more than 0, such as 8Gi"),
        ("", "more than 0, such as 8Gi"),
        ("0Gi", "more than 0, such as 8Gi"),
    ],
)
def test_memory_bytes_refuses_anything_else(text, right):
    with pytest.raises(ValueError, match=re.escape(right)) as error:
        memory_bytes(text)
    assert repr(text) in str(error.value)


@given(st.integers(1, 2**50))
def test_memory_texts_read_back_equal(size):
    assert memory_bytes(kubernetes_memory(size)) == size


def test_memory_texts_take_largest_unit_of_whole_number():
    assert [kubernetes_memory(size) for size in (2**33, 3 * 2**29, 10**9, 1)] == ["8Gi", "1536Mi", "1000000000", "1"]
