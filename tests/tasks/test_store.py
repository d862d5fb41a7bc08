"""Promises of every store, in a folder as well as at an address."""

import logging
import os
import pickle
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from table import each_row

from vastflow.tasks.store.remote_files import RemoteFiles
from vastflow.tasks.store.store import Lost, Store, open_store

KEY, HOME = "evaluate/ab/abcd/0-5", "evaluate/ab/abcd"
CONTENT = "338736d3cc5239f43388b32f21328523e790542620966d1e65b34ce99582cf83"


@pytest.fixture(params=["folder", "memory", pytest.param("s3", marks=pytest.mark.slow)])
def store(request, tmp_path):
    """An empty store of each kind."""
    if request.param == "folder":
        return open_store(tmp_path / "store")
    address = request.getfixturevalue(request.param)
    return Store(address) if request.param == "memory" else open_store(address)


@pytest.fixture
def files(store, raw):
    return raw(store)


def change(files, name, content):
    """Write a file of the artifact behind the store's back; None deletes it."""
    if content is None:
        files.delete(files.path(KEY, name))
    else:
        files.write(files.path(KEY, name), content)


def test_store_returns_files_facts_and_sidecars(store, files):
    assert (store.find(KEY), store.under(HOME)) == (None, ())
    with pytest.raises(Lost, match="is not in the store"):
        store.read(KEY, "a.bin")
    store.put(KEY, {"a.bin": b"one", "b.bin": b"two"}, {"runs": [[0, 12.5]]}, {"runlog.json": b"{}"})
    store.put(f"{HOME}/5-8", {"a.bin": b"one"})
    assert (store.read(KEY, "b.bin"), store.find(KEY).info) == (b"two", {"runs": [[0, 12.5]]})
    assert store.under(HOME) == ("0-5", "5-8")
    assert store.beside(KEY, "runlog.json") == b"{}"
    files.delete(files.path(KEY, "runlog.json"))
    assert store.find(KEY) is not None and store.beside(KEY, "runlog.json") is None


def test_content_digest_is_pinned_and_depends_on_files_alone(store):
    first = store.put(KEY, {"a.bin": b"one"}, info={"x": 1}, sidecar={"log.json": b"1"})
    other = store.put("evaluate/ab/other/0-5", {"a.bin": b"one"}, info={"x": 2})
    assert first.content == other.content == store.find(KEY).content == CONTENT


def test_changed_byte_is_noticed_when_read(store, files, caplog):
    store.put(KEY, {"a.bin": b"one"})
    change(files, "a.bin", b"onf")
    with caplog.at_level(logging.WARNING), pytest.raises(Lost, match="damaged"):
        store.read(KEY, "a.bin")
    assert store.find(KEY) is None
    assert f"{KEY} is damaged and will be computed again: a.bin is not what was written" in caplog.text


DAMAGES = [
    ("a.bin", b"onf", "a.bin is not what was written", ""),
    ("a.bin", b"on", "a.bin is not what was written", "a.bin has 2 of 3 bytes"),
    ("a.bin", None, "a.bin is missing", ""),
    ("manifest", None, "manifest is missing", ""),
    *[
        ("manifest", text, "manifest is not what was written", "manifest is not")
        for text in (b"", b"0\n{}", b"\xff\n\xff")
    ],
]


@pytest.mark.parametrize(("name", "content", "fault", "logged"), DAMAGES)
def test_damaged_artifact_is_described_not_found_and_replaced(store, files, caplog, name, content, fault, logged):
    store.put(KEY, {"a.bin": b"one"})
    assert store.fault(KEY) is None
    change(files, name, content)
    assert [store.fault(KEY), store.fault(KEY)] == [fault] * 2
    assert [each.whole for each in store.holdings()] == [(name, content) != ("manifest", None)]
    if (name, content) != ("a.bin", b"onf"):  # which only reading tells
        assert store.find(KEY) is None and logged in caplog.text
    store.put(KEY, {"a.bin": b"two"})
    assert store.read(KEY, "a.bin") == b"two"


def test_file_deleted_after_listing_is_lost(store, files):
    artifact = store.put(KEY, {"a.bin": b"one"})
    change(files, "a.bin", None)
    with pytest.raises(Lost, match=r"a\.bin went away"):
        store.load(artifact, "a.bin")
    assert store.find(KEY) is None


@pytest.mark.parametrize("refreshed", [False, True])
@pytest.mark.parametrize("other", ["evaluate/ab/other/0-5", "evaluate/ab/abcd/5-10"])
def test_copied_artifact_under_wrong_key_is_detected(store, files, other, refreshed, caplog):
    store.put(other, {"a.bin": b"other"}, info={"runs": []})
    for path in files.paths(other):
        files.write(path.replace(other, KEY), files.read(path))
    assert store.fault(KEY) == f"it is a copy of {other}"
    if refreshed:
        store.refresh()
    assert store.find(KEY) is None
    assert f"{KEY} is damaged and will be computed again: it is a copy of {other}" in caplog.text
    store.put(KEY, {"a.bin": b"one"})
    assert (store.read(KEY, "a.bin"), store.read(other, "a.bin")) == (b"one", b"other")


def test_second_writer_leaves_an_undamaged_artifact(store):
    first = store.put(KEY, {"a.bin": b"one"})
    assert store.put(KEY, {"a.bin": b"another"}).content == first.content
    assert store.read(KEY, "a.bin") == b"one"


@pytest.mark.parametrize("kind", ["folder", "s3"])
def test_concurrent_writers_leave_whole_artifacts(kind, tmp_path, request):
    place = str(tmp_path / "store") if kind == "folder" else request.getfixturevalue("s3")
    store = open_store(place)
    writers = [subprocess.Popen([sys.executable, "-c", WRITE_MANY, place, str(i)]) for i in range(2)]
    assert [writer.wait(200) for writer in writers] == [0, 0]
    lost = 0
    for i in range(30):
        try:
            assert store.read(f"evaluate/ab/k{i}/0-1", "a.bin")[:1] in (b"0", b"1")
        except Lost:  # rclone keeps neither of two that write one object at once
            lost += 1
    assert lost <= (3 if kind == "s3" else 0)
    if kind == "folder":
        assert list((store.local / "temporary").iterdir()) == []


WRITE_MANY = """
import sys
from vastflow.tasks.store.store import open_store
store = open_store(sys.argv[1])
for i in range(30):
    store.put(f"evaluate/ab/k{i}/0-1", {"a.bin": sys.argv[2].encode() * 1000})
"""


@pytest.mark.parametrize("kind", ["folder", "memory"])
def test_writers_survive_concurrent_removal(kind, tmp_path, request):
    store = open_store(tmp_path / "store") if kind == "folder" else Store(request.getfixturevalue("memory"))
    written = threading.Event()

    def remove_all():
        while not written.is_set():
            store.remove([holding.key for holding in store.holdings()])

    def write(writer):
        for i in range(400):
            store.put(f"evaluate/ab/k{i % 3}/{writer % 2}-5", {"a.bin": b"a"})

    with ThreadPoolExecutor(6) as threads:
        removers = [threads.submit(remove_all) for _ in range(2)]
        writers = [threads.submit(write, writer) for writer in range(4)]
        try:
            for each in writers:
                each.result(60)
        finally:
            written.set()
        for each in removers:
            each.result(60)
    assert store.put(KEY, {"a.bin": b"one"}) == store.find(KEY)


def test_listing_matches_store_after_concurrent_changes(store):
    store.put(KEY, {"a.bin": b"one"})
    store.refresh()
    sent = pickle.loads(pickle.dumps(store))
    assert (sent.place, sent.read(KEY, "a.bin")) == (store.place, b"one")
    assert (store.find(KEY).content, store.under(HOME), store.find(f"{HOME}/8-9")) == (CONTENT, ("0-5",), None)
    store.put(f"{HOME}/5-8", {"a.bin": b"one"})
    assert store.under(HOME) == ("0-5", "5-8")
    for key in (f"{HOME}/8-9", "observe/ab/abcd"):
        sent.put(key, {"a.bin": b"one"})
    store.changed(HOME)
    store.changed("observe/ab/abcd")
    assert store.under(HOME) == ("0-5", "5-8", "8-9")
    assert store.find(f"{HOME}/8-9").content == store.find("observe/ab/abcd").content == CONTENT
    sent.discard(KEY, "why not")
    store.refresh()
    assert (store.find(KEY), store.under(HOME)) == (None, ("5-8", "8-9"))


@pytest.mark.parametrize("name", ["a.bin", "manifest"])
def test_listing_notices_damage(store, files, name, caplog):
    store.put(KEY, {"a.bin": b"one"})
    change(files, name, b"on")
    store.refresh()
    assert store.find(KEY) is None
    assert f"{KEY} is damaged" in caplog.text


def test_holdings_have_stage_size_and_time(store):
    for key in (KEY, "report/ab/abcd"):
        store.put(key, {"a.bin": b"x" * 1000}, sidecar={"log": b"y" * 10})
    found = store.holdings()
    assert [(each.key, each.stage) for each in found] == [(KEY, "evaluate"), ("report/ab/abcd", "report")]
    assert all(1010 < each.size_bytes < 1300 for each in found)
    assert abs(found[0].written_s - found[1].written_s) < 60


@pytest.mark.parametrize("number", [3, 30])
def test_removal_deletes_one_artifact_completely(store, files, number):
    keys = [f"evaluate/ab/abcd{i}/0-5" for i in range(number)]
    for key in keys:
        store.put(key, {"a.bin": b"one"}, sidecar={"log": b"1"})
    store.refresh()
    store.remove(keys[1:])
    assert [each.key for each in store.holdings()] == keys[:1]
    assert [store.find(key) is not None for key in keys[:3]] == [True, False, False]
    assert len(files.paths()) == 3


def test_refresh_reads_unchanged_manifests_from_copies_unless_these_are_damaged(s3, monkeypatch):
    store = open_store(s3)
    store.put(KEY, {"a.bin": b"one"})
    store.refresh()
    copies = store.local / "manifests.json"
    whole = copies.read_bytes()
    for spoilt in (b"", b"[1]", b"\xff", whole.replace(b"files", b"filez")):
        copies.write_bytes(spoilt)
        again = open_store(s3)
        again.refresh()
        assert again.find(KEY).content == CONTENT
    copies.write_bytes(whole)
    again = open_store(s3)
    monkeypatch.setattr(again._files._files, "cat", None)
    again.refresh()
    assert again.find(KEY).content == CONTENT


def test_early_listing_recomputes_nothing(memory, monkeypatch, caplog):
    # Another campaign writes files and manifest while the pages of a long listing come in.
    store = Store(memory)
    store.put(KEY, {"a.bin": b"content"})
    listed = RemoteFiles._listed

    def manifests(self, key):
        return {name: file for name, file in listed(self, key).items() if key or name.endswith("manifest")}

    monkeypatch.setattr(RemoteFiles, "_listed", manifests)
    store.refresh()
    assert store.read(KEY, "a.bin") == b"content"
    assert caplog.records == []


def test_verification_skips_content_of_wrong_size(tmp_path):
    store = open_store(tmp_path)
    store.put(KEY, {"a.bin": b"one"})
    os.truncate(tmp_path / KEY / "a.bin", 100 * 2**30)
    assert store.fault(KEY) == "a.bin is not what was written"


def test_read_only_store_keeps_new_artifacts_in_memory(tmp_path):
    store = open_store(tmp_path / "store", read_only=True)
    artifact = store.put(KEY, {"x": b"1"})
    assert (store.read(KEY, "x"), store.find(KEY)) == (b"1", artifact)
    assert not (tmp_path / "store").exists()


@each_row("damaged", [False, True])
def test_read_only_store_hides_removed_and_damaged_artifacts(tmp_path, caplog, damaged):
    whole = open_store(tmp_path / "store")
    artifact = whole.put(KEY, {"x": b"1"})
    store = open_store(tmp_path / "store", read_only=True)
    if damaged:
        (whole.local / KEY / "x").write_bytes(b"2")
        with pytest.raises(Lost, match="x is damaged"):
            store.load(artifact, "x")
    else:
        store.remove([KEY])
    assert store.find(KEY) is None
    assert whole.find(KEY) is not None and caplog.records == []
