"""Places of stores, and errors of unusable ones."""

import errno
import os
import socket
import threading
import time
from pathlib import Path

import fsspec
import pytest
from asleep import wait_until
from table import each_row

from vastflow.producers.floorplan.environment import environments_folder
from vastflow.tasks.store.remote_files import RemoteFiles, file_system
from vastflow.tasks.store.store import Store, StoreError, open_store, store_root

KEY = "evaluate/ab/abcd/0-5"


def test_remains_of_killed_writers_are_removed_after_a_day(tmp_path):
    store = open_store(tmp_path / "store")
    old, young = store.local / "temporary" / "old", store.local / "temporary" / "young"
    old.mkdir()
    young.mkdir()
    long_ago = time.time() - 2 * 24 * 3600
    os.utime(old, (long_ago, long_ago))
    open_store(store.local)
    assert not old.exists()
    assert young.exists()


def test_store_place_is_argument_variable_or_user_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "variable"))
    assert store_root(tmp_path / "given") == tmp_path / "given"
    assert store_root() == tmp_path / "variable"
    monkeypatch.delenv("VASTFLOW_STORE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert store_root() == tmp_path / "cache" / "vastflow" / "store"
    assert open_store(f"file://{tmp_path}/store").local == tmp_path / "store"
    places = {Store(f"s3://bucket/{name}").local for name in ("a", "b")}
    assert len(places) == 2 and all(place.is_relative_to(tmp_path / "cache") for place in places)


def test_store_variable_may_be_an_address(s3, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", s3)
    assert open_store().place == s3
    assert environments_folder().is_relative_to(tmp_path / "cache" / "vastflow")


def test_stores_share_client_while_credentials_are_the_same(monkeypatch):
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "one")
    first, _ = file_system("s3://bucket/shared")
    assert file_system("s3://bucket/shared")[0] is first
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "other")
    assert file_system("s3://bucket/shared")[0] is not first


def test_unwritable_place_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=r"store: can't write to .*file.*--store"):
        open_store(tmp_path / "file")


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("nonsense://bucket/store", r"'nonsense://bucket/store' .*Protocol not known.*s3://bucket/prefix"),
        ("memory://store", "expected a folder, or s3://bucket/prefix, got 'memory://store', which no other"),
        ("abfs://container/store", r"ImportError.*Install what it names"),
    ],
)
def test_impossible_address_is_refused_and_creates_no_folder(tmp_path, monkeypatch, address, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StoreError, match=words):
        open_store(address)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_silent_server_is_asked_six_times_and_named(monkeypatch):
    monkeypatch.setattr("vastflow.tasks.store.remote_files._ANSWER_S", 0.2)
    asked = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=lambda: [asked.append(server.accept()) for _ in range(20)], daemon=True).start()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{server.getsockname()[1]}")
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "someone")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        with pytest.raises(
            StoreError, match=r"can't use 's3://bucket/store' .*imeout.*Check the network and the server"
        ):
            open_store("s3://bucket/store")
        wait_until(lambda: len(asked) >= 6)
        assert len(asked) == 6


@pytest.mark.parametrize(
    ("key_id", "secret", "address", "words"),
    [
        ("TESTKEYID", "TESTSECRET", "s3://nowhere/x", r"'s3://nowhere/x' .*bucket does not exist.*Make the bucket"),
        (
            "TESTKEYID",
            "wrong",
            "s3://bucket/x",
            r"'s3://bucket/x' \(PermissionError: .*Check the credentials \(AWS_ACC",
        ),
        ("nobody", "TESTSECRET", "s3://bucket/x", r"PermissionError: .*Check the credentials"),
        (None, None, "s3://bucket/x", r"NoCredentialsError.*Check the credentials"),
    ],
)
def test_refused_store_error_has_cause_and_remedy(shared_s3, s3_variables, monkeypatch, key_id, secret, address, words):
    s3_variables(shared_s3, key_id or "", secret or "")
    if key_id is None:
        monkeypatch.delenv("AWS_ACCESS_KEY_ID")
        monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    with pytest.raises(StoreError, match=words):
        open_store(address)


@pytest.mark.slow
def test_error_names_unreachable_server(start_s3, s3_variables):
    server = start_s3()
    s3_variables(server)
    store = open_store("s3://bucket/x")
    server.kill()
    for ask in (store.refresh, lambda: store.find(KEY), lambda: store.put(KEY, {"a.bin": b"one"})):
        with pytest.raises(StoreError, match=rf"'s3://bucket/x' .*{server.url}.*\. Check the network and the server"):
            ask()


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2])
def test_server_killed_during_a_put_leaves_no_artifact_and_works_when_restarted(
    start_s3, s3_variables, monkeypatch, number
):
    server = start_s3()
    s3_variables(server)
    store = open_store("s3://bucket/x")
    write, left = RemoteFiles._write, [number]

    def killed_before(files, contents):
        left[0] -= 1
        if not left[0]:
            server.kill()
        write(files, contents)

    with monkeypatch.context() as patch:
        patch.setattr(RemoteFiles, "_write", killed_before)
        with pytest.raises(StoreError, match="What was finished is kept"):
            store.put(KEY, {"a.bin": b"one", "b.bin": b"two"})
    server.start()
    assert store.find(KEY) is None
    store.put(KEY, {"a.bin": b"one", "b.bin": b"two"})
    assert store.read(KEY, "a.bin") == b"one"


FILES = {"a.bin": b"one" * 1000, "b.bin": b"two" * 1000}


FULL = [
    *(("folder", number, code) for number in range(4) for code in (errno.ENOSPC, errno.EROFS, errno.EIO)),
    *(("memory", number, errno.ENOSPC) for number in range(4)),
]


@each_row(("kind", "number", "code"), FULL)
def test_full_place_has_whole_artifacts_or_none(tmp_path, memory, monkeypatch, kind, number, code):
    """The write of each file in turn fails, in a folder half-way."""
    store = open_store(tmp_path / f"store-{number}-{code}") if kind == "folder" else Store(f"{memory}/{number}")
    owner, name = (Path, "write_bytes") if kind == "folder" else (fsspec.get_filesystem_class("memory"), "pipe_file")
    left, write = [number], getattr(owner, name)

    def full(*arguments, **options):
        *place, content = arguments
        if not left[0]:
            if kind == "folder":
                write(*place, content[: len(content) // 2])
            raise OSError(code, os.strerror(code), str(place[-1]))
        left[0] -= 1
        return write(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, full)
        with pytest.raises(StoreError, match=rf"{os.strerror(code)}.*\. "):
            store.put(KEY, FILES, sidecar={"log": b"1"})
    assert store.find(KEY) is None
    assert kind != "folder" or list((store.local / "temporary").iterdir()) == []
    store.put(KEY, FILES)
    assert store.read(KEY, "b.bin") == FILES["b.bin"]
