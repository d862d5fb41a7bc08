import logging
import os
import subprocess
import sys
import time

import pytest

from vastflow.tasks.store import LocalStore, Lost, StoreError, open_store, store_root

KEY = "execute/ab/abcd/0-5"


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


def test_what_is_put_is_read(store):
    store.put(KEY, {"a.bin": b"one", "b.bin": b"two"})
    assert store.read(KEY, "b.bin") == b"two"


def test_the_content_digest_is_pinned(store):
    assert (
        store.put(KEY, {"a.bin": b"one"}).content == "338736d3cc5239f43388b32f21328523e790542620966d1e65b34ce99582cf83"
    )


def test_the_content_digest_is_of_the_files_alone(store):
    first = store.put(KEY, {"a.bin": b"one"}, info={"x": 1}, sidecar={"log.json": b"1"})
    other = store.put("execute/ab/other/0-5", {"a.bin": b"one"}, info={"x": 2})
    assert first.content == other.content


def test_small_facts_are_found_without_reading_the_files(store):
    store.put(KEY, {"a.bin": b"one"}, info={"runs": [[0, 12.5]]})
    assert store.find(KEY).info == {"runs": [[0, 12.5]]}


def test_a_sidecar_lies_beside_the_files_and_is_not_promised(store):
    store.put(KEY, {"a.bin": b"one"}, sidecar={"runlog.json": b"{}"})
    (store.root / KEY / "runlog.json").unlink()
    assert store.find(KEY) is not None


def test_artifacts_below_a_key_are_listed(store):
    store.put("execute/ab/abcd/5-8", {"a.bin": b"one"})
    store.put("execute/ab/abcd/0-5", {"a.bin": b"one"})
    assert store.under("execute/ab/abcd") == ("0-5", "5-8")
    assert store.under("execute/ab/nothing") == ()


def test_what_was_never_put_is_not_found(store):
    assert store.find(KEY) is None
    with pytest.raises(Lost, match="is not in the store"):
        store.read(KEY, "a.bin")


def test_a_changed_byte_is_noticed_when_read_and_the_artifact_is_gone(store, caplog):
    store.put(KEY, {"a.bin": b"one"})
    (store.root / KEY / "a.bin").write_bytes(b"onf")
    with caplog.at_level(logging.WARNING), pytest.raises(Lost, match="damaged"):
        store.read(KEY, "a.bin")
    assert store.find(KEY) is None
    assert f"{KEY} is damaged and will be computed again: a.bin is not what was written" in caplog.text


def test_a_shortened_file_is_noticed_without_reading_it(store, caplog):
    store.put(KEY, {"a.bin": b"one"})
    (store.root / KEY / "a.bin").write_bytes(b"on")
    assert store.find(KEY) is None
    assert "a.bin has 2 of 3 bytes" in caplog.text


def test_a_missing_file_is_noticed_and_can_be_put_again(store):
    store.put(KEY, {"a.bin": b"one"})
    (store.root / KEY / "a.bin").unlink()
    assert store.find(KEY) is None
    store.put(KEY, {"a.bin": b"one"})
    assert store.read(KEY, "a.bin") == b"one"


def test_an_altered_manifest_is_noticed(store, caplog):
    store.put(KEY, {"a.bin": b"one"}, info={"passed": 1})
    manifest = store.root / KEY / "manifest"
    manifest.write_text(manifest.read_text().replace('"passed": 1', '"passed": 5'))
    assert store.find(KEY) is None
    assert "manifest is not what was written" in caplog.text


@pytest.mark.parametrize("manifest", ["", "{}", "0\n{}", "\n"])
def test_an_unreadable_manifest_is_a_missing_artifact(store, manifest):
    store.put(KEY, {"a.bin": b"one"})
    (store.root / KEY / "manifest").write_text(manifest)
    assert store.find(KEY) is None
    assert store.put(KEY, {"a.bin": b"one"}).key == KEY


def test_a_second_writer_leaves_what_is_there(store):
    first = store.put(KEY, {"a.bin": b"one"})
    second = store.put(KEY, {"a.bin": b"another"})
    assert second.content == first.content
    assert store.read(KEY, "a.bin") == b"one"


def test_a_second_writer_replaces_what_is_damaged(store):
    store.put(KEY, {"a.bin": b"one"})
    (store.root / KEY / "a.bin").write_bytes(b"bad")
    store.put(KEY, {"a.bin": b"two"})
    assert store.read(KEY, "a.bin") == b"two"


def test_writers_at_the_same_time_are_harmless(tmp_path):
    root = tmp_path / "store"
    open_store(root)
    writers = [subprocess.Popen([sys.executable, "-c", WRITE_MANY, str(root), str(i)]) for i in range(2)]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    store = LocalStore(root)
    assert all(store.read(f"execute/ab/k{i}/0-1", "a.bin")[:1] in (b"0", b"1") for i in range(50))
    assert list((root / "temporary").iterdir()) == []


WRITE_MANY = """
import sys
from pathlib import Path
from vastflow.tasks.store import LocalStore
for i in range(50):
    LocalStore(Path(sys.argv[1])).put(f"execute/ab/k{i}/0-1", {"a.bin": sys.argv[2].encode() * 1000})
"""


def test_what_killed_writers_left_is_swept_after_a_day(tmp_path):
    store = open_store(tmp_path / "store")
    old, young = store.root / "temporary" / "old", store.root / "temporary" / "young"
    old.mkdir()
    young.mkdir()
    long_ago = time.time() - 2 * 24 * 3600
    os.utime(old, (long_ago, long_ago))
    open_store(store.root)
    assert not old.exists()
    assert young.exists()


def test_the_place_is_the_argument_else_the_variable_else_the_users_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "variable"))
    assert store_root(tmp_path / "given") == tmp_path / "given"
    assert store_root() == tmp_path / "variable"
    monkeypatch.delenv("VASTFLOW_STORE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert store_root() == tmp_path / "cache" / "vastflow" / "store"


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=r"store: can't write to .*file.*--store"):
        open_store(tmp_path / "file")


def test_a_place_that_is_no_folder_is_refused_and_not_made_into_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StoreError, match=r"found 's3://bucket/store'; a local folder"):
        open_store("s3://bucket/store")
    assert list(tmp_path.iterdir()) == []
