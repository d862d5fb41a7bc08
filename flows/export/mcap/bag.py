"""A bag in memory: messages in any order of time, written at once as a directory that `ros2 bag` reads."""

import tempfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from vastflow.flows.export.mcap.topics import TOPICS, offered, typestore

NAME: Final = "rosbag2"
"""Name of the directory and of the file in it."""
_RANK: Final = {topic: rank for rank, topic in enumerate(TOPICS)}


class Bag:
    """Messages with their times, without those of some topics."""

    def __init__(self, without: Collection[str] = ()) -> None:
        self._without = without
        self._messages: list[tuple[int, int, int, str, bytes]] = []
        self._store = typestore()

    def make(self, kind: str, **values: Any) -> Any:
        """Return a message of a type such as `nav_msgs/Path`, given all of its fields."""
        package, _, name = kind.partition("/")
        return self._store.types[f"{package}/msg/{name}"](**values)

    def add(self, topic: str, t_ns: int, message: Any) -> None:
        """Add a message at a time of the run."""
        if topic in self._without:
            return
        content = bytes(self._store.serialize_cdr(message, TOPICS[topic].kind))
        self._messages.append((t_ns, _RANK[topic], len(self._messages), topic, content))

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
                used = {topic for *_, topic, _ in self._messages}
                connections = {
                    name: writer.add_connection(
                        name, topic.kind, typestore=self._store, offered_qos_profiles=[offered(topic)]
                    )
                    for name, topic in TOPICS.items()
                    if name in used
                }
                for t_ns, _, _, topic, content in sorted(self._messages):
                    writer.write(connections[topic], t_ns, content)
            description = place / "metadata.yaml"
            told = yaml.safe_load(description.read_text(encoding="utf-8"))
            told["rosbag2_bagfile_information"]["ros_distro"] = "jazzy"  # of the types; the writer can't say it
            description.write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")
            return {file.name: file.read_bytes() for file in sorted(place.iterdir())}
