"""Manifests with a right checksum and a wrong shape, and files of a store that are no files."""

import hashlib
import json
import os
import pickle
import re
from pathlib import Path

import pytest
from store_manifests import SOUND, promise_of, read_manifest

from vastflow.tasks.store.artifact import public_address, redacted
from vastflow.tasks.store.store import Lost, StoreError, open_store

KEY = "observe/ab/abcd/0-5"


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


WRONG_SHAPES = {
    "a list": [1, 2],
    "nothing": None,
    "no mapping of runs": {"info": {"runs": {"x": 1}, "causes": []}},
    "runs that are no pairs": {"info": {"runs": [1, 2], "causes": []}},
    "no runs": {"info": {}},
    "a file without its size": {"files": {"a.bin": {"sha256": "ab"}}},
    "a file with a size in words": {"files": {"a.bin": {"sha256": "ab", "size": "many"}}},
    "deep facts": {"info": {"runs": [], "causes": [], "deep": json.loads("[" * 900 + "]" * 900)}},
}


@pytest.mark.parametrize("shape", WRONG_SHAPES)
def test_manifest_with_right_checksum_and_wrong_shape_is_damage(store, caplog, shape):
    key, wrong = "judge/ab/abcd", WRONG_SHAPES[shape]
    store.put(key, {"a.bin": b"a"}, {"runs": [[0, "pass"]], "causes": []})
    manifest = Path(store.place, key, "manifest")
    body = {**json.loads(manifest.read_bytes().partition(b"\n")[2]), **wrong} if isinstance(wrong, dict) else wrong
    promise = json.dumps(body).encode()
    manifest.write_bytes(hashlib.sha256(promise).hexdigest().encode() + b"\n" + promise)
    assert "manifest" in store.fault(key)
    assert store.find(key) is None
    (line,) = caplog.messages
    assert line.startswith(f"{key} is damaged and will be computed again: manifest") and "\n" not in line
    assert store.find(key) is None and not manifest.exists()


def test_manifest_of_brackets_alone_is_damage(store):
    store.put(KEY, {"a.bin": b"a"})
    promise = b"[" * 1_000_000
    Path(store.place, KEY, "manifest").write_bytes(hashlib.sha256(promise).hexdigest().encode() + b"\n" + promise)
    assert "manifest" in store.fault(KEY)
    assert store.find(KEY) is None


@pytest.mark.timeout(30)
def test_manifest_that_is_a_file_of_the_kernel_is_damage(store):
    store.put(KEY, {"a.bin": b"a"})
    manifest = Path(store.place, KEY, "manifest")
    manifest.unlink()
    manifest.symlink_to("/proc/kmsg")  # it has nothing to read yet
    assert store.find(KEY) is None


@pytest.mark.parametrize("name", ["manifest", "a.bin"])
@pytest.mark.timeout(30)
def test_pipe_or_folder_in_place_of_a_file_is_damage(store, name):
    for make in (os.mkfifo, os.mkdir):
        store.put(KEY, {"a.bin": b""})
        Path(store.place, KEY, name).unlink()
        make(Path(store.place, KEY, name))
        assert "is no regular file" in store.fault(KEY)
        with pytest.raises(Lost, match=KEY):
            store.read(KEY, "a.bin")
        assert store.find(KEY) is None


def test_artifact_without_a_file_of_its_stage_is_computed_again(store):
    store.put(KEY, {"other.bin": b"a"})
    with pytest.raises(Lost, match=r"a\.bin"):
        store.read(KEY, "a.bin")
    assert store.find(KEY) is None


@pytest.mark.parametrize("secret", ["KEY:SE/CRET@", "SECRET@"])
def test_store_error_has_no_credentials_of_an_address(secret):
    error = StoreError(f"store: can't use 's3://{secret}bucket/x?X-Amz-Signature=SECRET&v=1'")
    for each in (error, pickle.loads(pickle.dumps(error))):
        assert str(each) == "store: can't use 's3://…@bucket/x?X-Amz-Signature=…&v=1'"
    assert public_address(f"s3://{secret}bucket/me@x?sig=SECRET") == "s3://bucket/me@x"
    assert redacted("tcp://host:8786/a@b and me@lab") == "tcp://host:8786/a@b and me@lab"


@pytest.mark.parametrize("key", SOUND)
def test_any_content_of_a_manifest_is_read_or_damage(store, key):
    sound = promise_of(store, key)
    assert read_manifest(store, key, sound) is None
    words = (
        b"null",
        b"[1, 2]",
        b'{"x": 1}',
        b"1e999",
        b"-1",
        b'"x"',
        b"NaN",
        b"9" * 5000,
        b"[" * 3000,
        b"\xff",
        b"true",
    )
    for part in re.finditer(rb"[^{}\[\]:, ]+|\[\[.*?\]\]", sound):
        for word in words:
            read_manifest(store, key, sound[: part.start()] + word + sound[part.end() :])
