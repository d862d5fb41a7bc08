import hashlib
from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from vastflow.tasks.engine.shards import MOST_TASK_RUNS, shard_ranges


def digests(count, prefix="member"):
    return [hashlib.sha256(f"{prefix} {i}".encode()).hexdigest() for i in range(count)]


def shards_of(configurations):
    return [tuple(configurations[i] for i in part) for part in shard_ranges(configurations)]


def test_small_campaign_has_one_configuration_a_shard():
    assert shard_ranges(digests(200)) == [range(i, i + 1) for i in range(200)]


def test_no_configurations_are_no_shards():
    assert shard_ranges([]) == []


@given(st.integers(0, 3000), st.integers(0, 5))
def test_every_configuration_is_in_exactly_one_shard_and_in_order(count, salt):
    parts = shard_ranges(digests(count, str(salt)))
    assert [i for part in parts for i in part] == list(range(count))


@given(st.integers(201, 8000), st.integers(0, 5))
def test_no_shard_is_larger_than_three_units(count, salt):
    unit = 2 ** max(0, (-(-count // MOST_TASK_RUNS) - 1).bit_length())
    assert max(map(len, shard_ranges(digests(count, str(salt))))) <= 3 * unit


def test_papers_campaign_has_about_two_hundred_shards():
    assert 100 < len(shard_ranges(digests(5480))) <= MOST_TASK_RUNS


def test_just_above_the_limit_there_are_not_more_shards_than_below_it():
    assert 100 < len(shard_ranges(digests(400))) < 230


def test_insertion_in_front_changes_one_shard():
    configurations = digests(5480)
    before, after = Counter(shards_of(configurations)), Counter(shards_of([*digests(1, "new"), *configurations]))
    assert sum((after - before).values()) <= 2


def test_edit_in_the_middle_changes_one_shard():
    configurations = digests(5480)
    edited = [*configurations[:2700], *digests(1, "edited"), *configurations[2701:]]
    before, after = Counter(shards_of(configurations)), Counter(shards_of(edited))
    assert sum((after - before).values()) <= 2


def test_cuts_are_pinned():
    assert [len(part) for part in shard_ranges(digests(1000))][:8] == [5, 4, 11, 4, 4, 15, 7, 8]
