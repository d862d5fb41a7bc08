import hashlib
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.tasks.engine.shards import MOST_TASK_RUNS, shard_ranges


def digests(count, prefix="member"):
    return [hashlib.sha256(f"{prefix} {i}".encode()).hexdigest() for i in range(count)]


def shards_of(configurations):
    return [tuple(configurations[i] for i in part) for part in shard_ranges(configurations)]


@given(st.integers(0, 8000), st.integers(0, 5))
def test_shards_hold_each_configuration_once_and_at_most_three_units(count, salt):
    parts = shard_ranges(digests(count, str(salt)))
    assert [i for part in parts for i in part] == list(range(count))
    unit = 2 ** max(0, (-(-count // MOST_TASK_RUNS) - 1).bit_length())
    assert max(map(len, parts), default=0) <= (3 * unit if unit > 1 else 1)


@pytest.mark.parametrize(("count", "least", "most"), [(200, 200, 200), (400, 101, 229), (5480, 101, MOST_TASK_RUNS)])
def test_number_of_shards_is_about_two_hundred(count, least, most):
    assert least <= len(shard_ranges(digests(count))) <= most


@pytest.mark.parametrize("place", [slice(0, 0), slice(2700, 2701)], ids=["insertion in front", "edit in the middle"])
def test_edit_of_one_configuration_changes_one_shard(place):
    before = digests(5480)
    after = [*before]
    after[place] = digests(1, "new")
    assert sum((Counter(shards_of(after)) - Counter(shards_of(before))).values()) <= 2


def test_cuts_are_pinned():
    assert [len(part) for part in shard_ranges(digests(1000))][:8] == [5, 4, 11, 4, 4, 15, 7, 8]
