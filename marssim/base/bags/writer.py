"""Write a ROS 2 bag: a folder with an MCAP file and metadata.yaml, which appears whole or not at all."""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from marssim.base.bags.library import check_installed, typestore
from marssim.base.files.atomic import naming, written_atomically
from marssim.base.files.json_file import DatasetError

METADATA_VERSION: Literal[8] = 8  # of metadata.yaml, which ROS 2 from Humble on reads


def check_new(path: Path) -> None:
    """Raise DatasetError if there is something at a path where a bag is to be written."""
    if path.exists():
        raise DatasetError(f"{path}: is there already; choose another folder for the bag")


class BagWriter:
    """A bag that is being written. Use it as a context manager: an exception in the block leaves no bag.

    Args:
        path: The folder of the bag.
        replace: Whether a bag that is there is replaced; without it, it is an error.

    Raises:
        DatasetError: There is something at `path`.
        ImportError: `rosbags` is not installed.
        OSError: The folder cannot be written.
    """

    def __init__(self, path: Path, replace: bool = False) -> None:
        check_installed(path)
        if not replace:
            check_new(path)
        from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer

        self.path = path
        self._topics: dict[str, Any] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as opened:
            part = opened.enter_context(written_atomically(path))
            self._writer = Writer(part, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
            self._writer.set_compression(CompressionMode.STORAGE, _zstd())
            with naming(path):
                self._writer.open()
            self._folder = opened.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with naming(self.path):
            try:
                self._writer.close()
                if kind is None and self.path.is_dir():
                    shutil.rmtree(self.path)
            except BaseException as failure:  # a bag that cannot be finished does not appear either
                self._folder.__exit__(type(failure), failure, failure.__traceback__)
                raise
            self._folder.__exit__(kind, error, traceback)

    def write(self, topic: str, stamp: int, message: Any, latched: bool = False) -> None:
        """Write a message.

        Args:
            topic: The topic; all of its messages have one type.
            stamp: Time of recording [ns].
            message: The message.
            latched: Whether late subscribers get it too, as that of /tf_static.
        """
        kind = message.__msgtype__
        if topic not in self._topics:
            self._topics[topic] = self._writer.add_connection(
                topic, kind, typestore=typestore(), offered_qos_profiles=_qos(latched)
            )
        with naming(self.path):
            self._writer.write(self._topics[topic], int(stamp), typestore().serialize_cdr(message, kind))


def _zstd() -> Any:
    from rosbags.rosbag2 import CompressionFormat

    return CompressionFormat.ZSTD


def _qos(latched: bool) -> list[Any]:
    """Return the quality of service that a publisher offers: reliable, and kept for late subscribers if latched."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(0, 0)
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return [
        Qos(
            QosHistory.KEEP_LAST, 1 if latched else 10, QosReliability.RELIABLE, durability, never, never,
            QosLiveliness.AUTOMATIC, never, False,
        )
    ]  # fmt: skip
