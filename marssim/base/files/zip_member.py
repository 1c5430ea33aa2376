"""Read files of zip archives that may come from elsewhere, of which the sizes in the directory may be wrong."""

from __future__ import annotations

import zipfile

PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
PIECE = 1 << 20  # [bytes] read at once: zipfile may unpack as much as is asked for, whatever size the archive gives


def read_member(archive: zipfile.ZipFile, name: str) -> bytes:
    """Return a file of an archive, of which never much more is unpacked than the size that the archive gives it.

    Args:
        archive: The archive.
        name: Name of the file in it.

    Raises:
        KeyError: There is no such file.
        NotImplementedError: It is packed by another way than storing and deflating, which may unpack without a limit.
        zipfile.BadZipFile, zlib.error, EOFError: It is damaged.
    """
    member = archive.getinfo(name)
    if member.compress_type not in PACKINGS:
        raise NotImplementedError(f"{name} is neither stored nor deflated")
    with archive.open(member) as file:
        return b"".join(iter(lambda: file.read(PIECE), b""))
