"""Read a ROS 2 bag: the folder with metadata.yaml, or a single .mcap or .db3 file."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from marssim.base.bags.library import check_definition, check_installed, typestore
from marssim.base.bags.messages import SECOND
from marssim.base.files.json_file import DatasetError

SUFFIXES = (".mcap", ".db3")
ROS_1 = ".bag"
METADATA = "metadata.yaml"
COMPRESSED = tuple(f"{suffix}.zstd" for suffix in SUFFIXES)
ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of what zstd compressed; those of a message are 0 and its order of bytes


@dataclass(frozen=True)
class Entry:
    """Where a message is in a bag.

    Attributes:
        topic: Its topic.
        stamp: Time in its header [ns].
        recorded: Time at which it was recorded [ns].
    """

    topic: str
    stamp: int
    recorded: int


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag, also like one without its metadata.yaml, or one of ROS 1."""
    if not path.is_dir():
        return path.name.lower().endswith((*SUFFIXES, *COMPRESSED, ROS_1))
    if any(next(path.glob(f"*{suffix}"), None) is not None for suffix in SUFFIXES):
        return True
    metadata = path / METADATA
    return metadata.is_file() and b"rosbag2" in metadata.read_bytes()[:1000]


class Bag:
    """An open bag.

    Attributes:
        path: The bag.
        topics: Type of each topic that has messages, "sensor_msgs/Image".

    Args:
        path: The folder, or a file of it.

    Raises:
        ImportError: `rosbags` is not installed.
        DatasetError: The bag cannot be read. One line that names it.
    """

    def __init__(self, path: Path) -> None:
        check_installed(path)
        from rosbags.rosbag2 import Reader

        self.path = path
        if path.suffix.lower() == ROS_1 and path.is_file():
            raise DatasetError(f"{path}: is a bag of ROS 1; `rosbags-convert` makes one of ROS 2 of it")
        if path.name.lower().endswith(COMPRESSED) and path.is_file():
            raise DatasetError(f"{path}: is compressed, as only the {METADATA} beside it says; give their folder")
        if path.is_dir() and not (path / METADATA).is_file():
            raise DatasetError(
                f"{path / METADATA}: no such file; `ros2 bag reindex` makes it, or give the .mcap file in the folder"
            )
        with self._naming():
            self._reader = Reader(path)
            self._reader.open()
        self.topics = {c.topic: c.msgtype.replace("/msg/", "/") for c in self._reader.connections if c.msgcount}

    def close(self) -> None:
        """Close the files; may be called twice."""
        with suppress(Exception):
            self._reader.close()

    def topics_of(self, *kinds: str) -> list[str]:
        """Return the topics of these types, sorted."""
        return sorted(topic for topic, kind in self.topics.items() if kind in kinds)

    def entries(self, topics: Sequence[str]) -> list[Entry]:
        """Return the place of each message of topics whose messages have headers, in the order of recording.

        Raises:
            DatasetError: The bag cannot be read to its end.
        """
        with self._naming():
            return [Entry(c.topic, _stamp(raw), recorded) for c, recorded, raw in self._raw(topics)]

    def messages(self, topics: Sequence[str]) -> Iterator[tuple[str, Any]]:
        """Yield topic and message of all messages of these topics, in the order of recording.

        Raises:
            DatasetError: The bag cannot be read to its end.
        """
        for connection, _, raw in self._raw(topics):
            yield connection.topic, self._decoded(connection, raw)

    def message(self, entry: Entry) -> Any:
        """Return one message.

        Raises:
            DatasetError: It cannot be read.
        """
        for connection, _, raw in self._raw([entry.topic], entry.recorded, entry.recorded + 1):
            if _stamp(raw) == entry.stamp:
                return self._decoded(connection, raw)
        raise DatasetError(f"{self.path}: has lost the message of {entry.topic} at {entry.stamp / SECOND:.3f} s")

    def _raw(
        self, topics: Sequence[str], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Any, int, bytes]]:
        connections = [c for c in self._reader.connections if c.topic in topics]
        if connections:  # the reader takes none for all
            with self._naming():
                for connection, recorded, raw in self._reader.messages(connections, start=start, stop=stop):
                    if raw[:4] == ZSTD:
                        raise DatasetError(
                            f"{self.path}: its messages are compressed, as only the {METADATA} beside it says; give "
                            "their folder"
                        )
                    yield connection, recorded, raw

    def _decoded(self, connection: Any, raw: bytes) -> Any:
        with self._naming(f", a message of {connection.topic}"):
            check_definition(connection.msgtype, connection.msgdef)
            return typestore().deserialize_cdr(raw, connection.msgtype)

    @contextmanager
    def _naming(self, what: str = "") -> Iterator[None]:
        """Turn whatever the library raises on a broken bag into one line that names the bag."""
        try:
            yield
        except (DatasetError, FileNotFoundError, PermissionError):
            raise
        except Exception as error:  # whatever the parsers meet: a broken length even exhausts the memory
            reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
            raise DatasetError(
                f"{self.path}{what}: is not readable as a ROS 2 bag: {reason}; is it truncated?"
            ) from None


def stamp_of(message: Any) -> int:
    """Return the stamp in the header of a message [ns]."""
    time = message.header.stamp
    return int(time.sec) * SECOND + int(time.nanosec)


def _stamp(raw: bytes | memoryview) -> int:
    """Return the stamp of a serialized message that begins with a header [ns], without decoding the rest."""
    seconds, rest = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, 4)
    return int(seconds) * SECOND + int(rest)
