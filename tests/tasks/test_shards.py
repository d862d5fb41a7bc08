import hashlib
from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from vastflow.tasks.engine.shards import MOST_TASK_RUNS, chunks


def digests(count, prefix="member"):
    return [hashlib.sha256(f"{prefix} {i}".encode()).hexdigest() for i in range(count)]


def shards_of(members):
    return [tuple(members[i] for i in part) for part in chunks(members)]


def test_small_campaign_has_one_member_a_shard():
    assert chunks(digests(200)) == [range(i, i + 1) for i in range(200)]


def test_no_members_are_no_shards():
    assert chunks([]) == []


@given(st.integers(0, 3000), st.integers(0, 5))
def test_every_member_is_in_exactly_one_shard_and_in_order(count, salt):
    parts = chunks(digests(count, str(salt)))
    assert [i for part in parts for i in part] == list(range(count))


@given(st.integers(201, 8000), st.integers(0, 5))
def test_no_shard_is_larger_than_three_units(count, salt):
    unit = 2 ** max(0, (-(-count // MOST_TASK_RUNS) - 1).bit_length())
    assert max(map(len, chunks(digests(count, str(salt))))) <= 3 * unit


def test_papers_campaign_has_about_two_hundred_shards():
    assert 100 < len(chunks(digests(5480))) <= MOST_TASK_RUNS


def test_just_above_the_limit_there_are_not_more_shards_than_below_it():
    assert 100 < len(chunks(digests(400))) < 230


def test_insertion_in_front_changes_one_shard():
    members = digests(5480)
    before, after = Counter(shards_of(members)), Counter(shards_of([*digests(1, "new"), *members]))
    assert sum((after - before).values()) <= 2


def test_edit_in_the_middle_changes_one_shard():
    members = digests(5480)
    edited = [*members[:2700], *digests(1, "edited"), *members[2701:]]
    before, after = Counter(shards_of(members)), Counter(shards_of(edited))
    assert sum((after - before).values()) <= 2


def test_cuts_are_pinned():
    assert [len(part) for part in chunks(digests(1000))][:8] == [5, 4, 11, 4, 4, 15, 7, 8]
