"""A store that is opened to be read only: what a dry run looks at."""

import pytest

from vastflow.tasks.store.store import Lost, open_store

KEY = "evaluate/aa/aa"


def test_what_is_put_into_it_stays_in_this_object(tmp_path):
    store = open_store(tmp_path / "store", read_only=True)
    artifact = store.put(KEY, {"x": b"1"})
    assert store.read(KEY, "x") == b"1"
    assert store.find(KEY) == artifact
    with pytest.raises(Lost, match="evaluate/bb/bb: x is not in the store"):
        store.read("evaluate/bb/bb", "x")
    assert not (tmp_path / "store").exists()


def test_what_is_damaged_seems_gone_and_stays_where_it_is(tmp_path, caplog):
    whole = open_store(tmp_path / "store")
    artifact = whole.put(KEY, {"x": b"1"})
    (whole.local / KEY / "x").write_bytes(b"2")
    store = open_store(tmp_path / "store", read_only=True)
    with pytest.raises(Lost, match="evaluate/aa/aa: x is damaged"):
        store.load(artifact, "x")
    assert store.find(KEY) is None
    assert (whole.local / KEY / "x").read_bytes() == b"2"
    assert caplog.records == []


def test_what_is_removed_from_it_seems_gone_only(tmp_path):
    whole = open_store(tmp_path / "store")
    whole.put(KEY, {"x": b"1"})
    store = open_store(tmp_path / "store", read_only=True)
    store.remove([KEY])
    assert store.find(KEY) is None
    assert whole.find(KEY) is not None
