"""Archives whose directory gives a wrong size: what is unpacked stays near it."""

import io
import struct
import tracemalloc
import zipfile
import zlib

import pytest

from marssim.base.files.zip_member import PIECE, read_member

BYTES = 64 << 20  # to which the archives unpack


def lying(packing: int, claimed: int) -> zipfile.ZipFile:
    """Return an archive with one file of BYTES zeros, whose size and checksum are said to be those of `claimed`."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing) as archive:
        archive.writestr("zeros", bytes(BYTES))
    data = bytearray(file.getvalue())
    directory = data.rindex(b"PK\x01\x02")
    data[directory + 16 : directory + 20] = struct.pack("<I", zlib.crc32(bytes(claimed)))
    data[directory + 24 : directory + 28] = struct.pack("<I", claimed)
    return zipfile.ZipFile(io.BytesIO(bytes(data)))


def test_not_much_more_is_unpacked_than_the_directory_says():
    with lying(zipfile.ZIP_DEFLATED, 100) as archive:
        tracemalloc.start()
        assert read_member(archive, "zeros") == bytes(100)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 3 * PIECE


@pytest.mark.parametrize("packing", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_packings_are_refused(packing):
    with lying(packing, 100) as archive, pytest.raises(NotImplementedError, match=r"^zeros is neither stored nor"):
        read_member(archive, "zeros")


@pytest.mark.parametrize("packing", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_whole_file_comes_back(packing):
    content = bytes(range(256)) * (2 * PIECE // 256 + 1)
    with zipfile.ZipFile(io.BytesIO(), "w", packing) as archive:
        archive.writestr("a", content)
        assert read_member(archive, "a") == content
