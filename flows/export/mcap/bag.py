"""A bag in memory: messages in any order of time, written at once as a directory that `ros2 bag` reads."""

import tempfile
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from vastflow.flows.export.mcap.topics import TOPICS, Topic, offered, typestore

NAME: Final = "rosbag2"
"""Name of the directory and of the file in it."""
_RANK: Final = {topic: rank for rank, topic in enumerate(TOPICS)}


class Bag:
    """Messages with their times, without those of some topics."""

    def __init__(self, without: Collection[str] = ()) -> None:
        self._without = without
        self._messages: list[tuple[int, int, int, str, str, bytes]] = []
        self._store = typestore()
        self._fields = cache(self._fields_of)

    def add(self, topic: str, t_ns: int, **values: Any) -> None:
        """Add a message at a time of the run.

        Args:
            values: Its fields, messages within them as mappings; a field without a value is zero or empty.
        """
        if topic in self._without:
            return
        kind = TOPICS[topic].kind
        self._append(topic, kind, t_ns, bytes(self._store.serialize_cdr(self._message(kind, values), kind)))

    def add_recorded(self, topic: str, kind: str, t_ns: int, content: bytes) -> bool:
        """Add a serialized message that a node published; False for a type whose definition is not known."""
        if is_known := kind in self._store.types:
            self._append(topic, kind, t_ns, content)
        return is_known

    def _append(self, topic: str, kind: str, t_ns: int, content: bytes) -> None:
        self._messages.append((t_ns, _RANK.get(topic, len(_RANK)), len(self._messages), topic, kind, content))

    def _message(self, kind: str, values: Mapping[str, Any]) -> Any:
        made = []
        for name, inner, nothing in self._fields(kind):
            given = values.get(name)
            if given is None:
                made.append(nothing)
            elif inner is None:
                made.append(given)
            elif isinstance(given, dict):
                made.append(self._message(inner, given))
            else:
                made.append([self._message(inner, each) for each in given])
        return self._store.types[kind](*made)

    def _fields_of(self, kind: str) -> list[tuple[str, str | None, Any]]:
        """Return name, type of the messages within, and empty value of each field."""
        from rosbags.interfaces import Nodetype

        fields: list[tuple[str, str | None, Any]] = []
        definitions: Any = self._store.fielddefs[kind][1]
        for name, (node, inner) in definitions:
            if node == Nodetype.NAME:
                fields.append((name, inner, self._message(inner, {})))
            elif node == Nodetype.BASE:
                fields.append((name, None, "" if inner[0] == "string" else 0))
            elif inner[0][0] == Nodetype.NAME:
                fields.append((name, inner[0][1], []))
            else:
                fields.append((name, None, np.zeros(inner[1], dtype=inner[0][1][0])))
        return fields

    def files(self, about: Mapping[str, str]) -> dict[str, bytes]:
        """Return the directory's files by name.

        Args:
            about: Entries of its `custom_data`; at least one, since readers expect a mapping.
        """
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        with tempfile.TemporaryDirectory(prefix="vastflow-bag-") as folder:
            place = Path(folder) / NAME
            writer = Writer(place, version=9, storage_plugin=StoragePlugin.MCAP)
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            for key, text in about.items():
                writer.set_custom_data(key, text)
            with writer:
                used = sorted({(rank, topic, kind) for _, rank, _, topic, kind, _ in self._messages})
                connections = {
                    (name, kind): writer.add_connection(
                        name, kind, typestore=self._store, offered_qos_profiles=[offered(TOPICS.get(name, Topic(kind)))]
                    )
                    for _, name, kind in used
                }
                for t_ns, _, _, *of, content in sorted(self._messages):
                    writer.write(connections[of[0], of[1]], t_ns, content)
            description = place / "metadata.yaml"
            told = yaml.safe_load(description.read_text(encoding="utf-8"))
            told["rosbag2_bagfile_information"]["ros_distro"] = "jazzy"  # of the types; the writer can't say it
            description.write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")
            return {file.name: file.read_bytes() for file in sorted(place.iterdir())}
