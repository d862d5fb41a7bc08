"""Copies of manifests on this machine, so that each is read only once from a store at an address."""

import contextlib
import json
import os
import uuid
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from vastflow.tasks.artifact import artifact_of


class ManifestCopies:
    """Copies by key and ETag: an object whose ETag is the same has the same content.

    A file system without ETags has no copies. A copy that can't be written costs time, nothing else.

    Args:
        file: Where they are kept.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        try:
            self._copies: dict[str, str] = dict(json.loads(file.read_bytes()))
        except (OSError, ValueError, TypeError):
            self._copies = {}
        self._kept = frozenset(self._copies)

    def find(self, key: str, entry: Mapping[str, Any]) -> bytes | None:
        """The manifest of `key`, if there is an undamaged copy.

        Args:
            entry: How the manifest is listed by its file system.
        """
        copy = self._copies.get(_tag(key, entry), "").encode()
        try:
            artifact_of(key, copy)
        except (ValueError, KeyError, TypeError):
            return None
        return copy

    def add(self, key: str, entry: Mapping[str, Any], manifest: bytes) -> None:
        """Copy a manifest that has been read."""
        if tag := _tag(key, entry):
            with contextlib.suppress(UnicodeDecodeError):  # a damaged one
                self._copies[tag] = manifest.decode()

    def keep(self, present: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        """Write the copies of manifests that are present, and forget the others.

        Args:
            present: Keys, and how their manifests are listed.
        """
        tags = [tag for key, entry in present if (tag := _tag(key, entry)) in self._copies]
        self._copies = {tag: self._copies[tag] for tag in tags}
        if self._kept == self._copies.keys():
            return
        self._kept = frozenset(self._copies)
        prepared = self._file.with_name(uuid.uuid4().hex)
        with contextlib.suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            prepared.write_text(json.dumps(self._copies), encoding="utf-8")
            os.replace(prepared, self._file)


def _tag(key: str, entry: Mapping[str, Any]) -> str:
    tag = entry.get("ETag")
    return f"{key} {tag}" if tag else ""
