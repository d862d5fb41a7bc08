"""A pack only saves time: whatever happens to it or to the store, it says what a look would say."""

import os

import pytest

from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine import index_cache as module
from vastflow.tasks.engine.index import Index, Member
from vastflow.tasks.engine.index_cache import FOLDER, MOST_SEGMENTS, member_pack
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import open_store

KEYS = Keys("numeric", "e", "o", "j", 0, [])


def member(name):
    return Member(name, "room", 1, Scenario("builtin:navigate_to_pose", 60.0, {}, {"goal": name}, {}), runs=2)


HALL, ROOM = member("hall"), member("room")


class Looks:
    """A store that counts the manifests that are read from it."""

    def __init__(self, store):
        self._store = store
        self.count = 0

    def __getattr__(self, name):
        return getattr(self._store, name)

    def find(self, key):
        self.count += 1
        return self._store.find(key)


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SETTLED_S", -100.0)
    return open_store(tmp_path)


def fill(store, *members):
    index = Index(store, KEYS)
    for each in members:
        home = KEYS.recordings(each.checked)
        block = store.put(
            f"{home}/0-2", {"recordings.parquet": f"of {each.name}".encode()}, {"runs": [[0, 0.1], [1, 0.25]]}
        )
        (found,) = index.stored(each)
        trace = store.put(index.trace_key(each, found.block), {"traces.parquet": b"t"})
        store.put(
            index.verdicts_key(each, found.block, trace.content), {"verdicts.json": b"[]"}, {"runs": [[0, "pass"]]}
        )
        assert block.content == found.block.content


def look(store, *members, keys=KEYS):
    """What an index with a pack finds, and how many manifests it read for that."""
    looks = Looks(store)
    index = Index(looks, keys, member_pack(store, keys, "campaign"))
    found = [index.stored(each) for each in members]
    index.keep()
    return found, looks.count


def plain(store, *members, keys=KEYS):
    return [Index(store, keys).stored(each) for each in members]


def pack_of(store):
    (file,) = (store.local / FOLDER).glob("*.pack")
    return file


def test_what_was_found_once_is_found_without_a_manifest_read(store):
    fill(store, HALL, ROOM)
    first, count = look(store, HALL, ROOM)
    assert count == 6
    again, count = look(store, HALL, ROOM)
    assert (again, count) == (first, 0)
    assert again == plain(store, HALL, ROOM)


def test_of_an_edited_campaign_only_what_is_new_is_looked_at(store):
    fill(store, HALL)
    look(store, HALL)
    fill(store, ROOM)
    assert look(store, HALL, ROOM)[1] == 3
    assert look(store, HALL, ROOM) == (plain(store, HALL, ROOM), 0)


def test_an_incomplete_member_is_looked_at_each_time(store):
    fill(store, HALL)
    more = Member("hall", "room", 1, HALL.scenario, runs=3)
    look(store, more)
    assert look(store, more)[1] == 3


def artifact_files(store):
    return sorted(each for each in store.local.glob("*/??/**/*") if each.is_file())


@pytest.mark.parametrize("number", range(6))
def test_a_file_that_is_deleted_is_missing(store, number):
    fill(store, HALL)
    look(store, HALL)
    files = artifact_files(store)
    assert len(files) == 6
    files[number].unlink()
    (found,), _ = look(store, HALL)
    assert not found or found[0].trace is None or found[0].verdicts is None
    assert [found] == plain(store, HALL)


@pytest.mark.parametrize("number", range(6))
def test_a_file_that_is_edited_with_its_old_time_is_looked_at(store, number):
    fill(store, HALL)
    look(store, HALL)
    file = artifact_files(store)[number]
    status, content = file.stat(), file.read_bytes()
    file.write_bytes(bytes([content[0] ^ 1]) + content[1:])
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert look(store, HALL)[1] > 0


def test_a_block_that_came_is_seen(store):
    fill(store, HALL)
    look(store, HALL)
    home = KEYS.recordings(HALL.checked)
    store.put(f"{home}/0-3", {"recordings.parquet": b"longer"})
    (found,), _ = look(store, HALL)
    assert [(each.block.start, each.block.stop) for each in found] == [(0, 3)]


def test_artifacts_that_were_removed_and_written_anew_are_looked_at(store):
    fill(store, HALL)
    before, _ = look(store, HALL)
    store.remove(
        [each.key for stored in before for one in stored for each in (one.recordings, one.trace, one.verdicts)]
    )
    assert look(store, HALL)[0] == [[]]
    fill(store, HALL)
    assert look(store, HALL) == (before, 3)


def test_other_keys_have_another_pack(store):
    fill(store, HALL)
    look(store, HALL)
    others = Keys("numeric", "e", "o", "another judge", 0, [])
    found, _ = look(store, HALL, keys=others)
    assert found == plain(store, HALL, keys=others)
    assert found[0][0].verdicts is None


@pytest.mark.parametrize(
    "damage", [lambda body: b"", lambda body: body[: len(body) // 2], lambda body: body[:-5] + b"x" + body[-4:]]
)
def test_a_damaged_pack_costs_looks_and_is_written_again(store, damage):
    fill(store, HALL)
    expected, _ = look(store, HALL)
    pack_of(store).write_bytes(damage(pack_of(store).read_bytes()))
    assert look(store, HALL) == (expected, 3)
    assert look(store, HALL) == (expected, 0)


def test_a_pack_under_the_name_of_another_is_not_believed(store):
    fill(store, HALL)
    look(store, HALL)
    others = Keys("numeric", "e", "another observer", "j", 0, [])
    file = pack_of(store)
    content = file.read_bytes()
    look(store, HALL, keys=others)
    other = (
        next(iter(set((store.local / FOLDER).glob("*.pack")) - {file}), None)
        or member_pack(store, others, "campaign")._file
    )
    other.write_bytes(content)
    assert look(store, HALL, keys=others)[0] == plain(store, HALL, keys=others)


def test_what_was_changed_just_now_is_not_kept(store, monkeypatch):
    monkeypatch.setattr(module, "SETTLED_S", 2.0)
    fill(store, HALL)
    look(store, HALL)
    assert look(store, HALL)[1] == 3
    monkeypatch.setattr(module, "SETTLED_S", -100.0)
    assert [look(store, HALL)[1] for _ in range(2)] == [3, 0]


def test_a_pack_does_not_grow_for_ever(store):
    for each in map(member, map(str, range(2 * MOST_SEGMENTS))):
        fill(store, each)
        look(store, HALL, each)
    content = pack_of(store).read_bytes()
    assert content.count(b"\n") <= MOST_SEGMENTS
    assert look(store, member(str(2 * MOST_SEGMENTS - 1)))[1] == 0


def test_a_folder_that_can_not_be_written_costs_time_alone(store):
    fill(store, HALL)
    (store.local / FOLDER).write_text("in the way")
    assert look(store, HALL) == (plain(store, HALL), 3)
