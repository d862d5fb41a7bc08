"""Amounts of memory in the units of Kubernetes and of Docker Compose."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.tasks.execution.description import compose_memory, kubernetes_memory, memory_bytes


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
def test_quantity_of_kubernetes_is_read(text, size):
    assert memory_bytes(text) == size


@each_row(
    ("text", "right"),
    [
        ("8GB", "did you mean '8Gi'?"),
        ("8g", "did you mean '8Gi'?"),
        ("8 Gi", "did you mean '8Gi'?"),
        ("512m", "did you mean '512Mi'?"),
        ("lots", "a quantity such as 8Gi or 512Mi"),
        ("-1Gi", "a quantity such as 8Gi or 512Mi"),
        ("", "a quantity such as 8Gi or 512Mi"),
    ],
)
def test_anything_else_is_refused_with_what_is_likely_meant(text, right):
    with pytest.raises(ValueError, match=r"^found ") as error:
        memory_bytes(text)
    assert str(error.value) == f"expected {right}, got {text!r}"


def test_no_memory_at_all_is_refused():
    with pytest.raises(ValueError, match=r"found '0Gi'; "):
        memory_bytes("0Gi")


@given(st.integers(1, 2**50))
def test_kubernetes_reads_back_what_is_written_for_it(size):
    assert memory_bytes(kubernetes_memory(size)) == size


@given(st.integers(1, 2**50))
def test_compose_reads_back_what_is_written_for_it(size):
    text = compose_memory(size)
    assert int(text[:-1]) * {"b": 1, "k": 2**10, "m": 2**20, "g": 2**30}[text[-1]] == size


def test_largest_unit_is_taken_that_leaves_a_whole_number():
    assert [kubernetes_memory(size) for size in (2**33, 3 * 2**29, 10**9, 1)] == ["8Gi", "1536Mi", "1000000000", "1"]
    assert [compose_memory(size) for size in (2**33, 3 * 2**29, 2**16, 1)] == ["8g", "1536m", "64k", "1b"]
