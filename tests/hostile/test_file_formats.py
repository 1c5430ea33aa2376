"""Damaged and forged files of every format are read, or refused in one line that names the file."""

import io
import pickle
import random
import re
import zipfile
import zlib
from collections.abc import Iterator

import pytest
from file_formats import FORMATS
from hypothesis import given
from hypothesis import strategies as st
from oracle import CODE, HARMED, Harm, count, judge, many, only_in_make_hostile, rng_of

from marssim.base.files.png import MAGIC

TOKEN = re.compile(rb'-?\d+\.?\d*(?:[eE][+-]?\d+)?|"[^"]*"|true|false|null')
TOKENS = (
    b"NaN", b"1e999", b"-1", b"0", b"0.5", b"9" * 400, b'""', b"null", b"[]", b"{}", b'"x"', b"[" * 100_000, b"true",
    b"\xff", b"1e300", CODE,
)  # fmt: skip
ARCHIVE = b"PK\3\4"  # begins a zip archive
MOST_VALUES = 60  # of a text that are replaced, each by each of TOKENS


def with_right_checksums(data: bytes) -> bytes:
    """Return a PNG file with the checksums of its chunks made right, up to the first that it does not hold whole."""
    fixed, at = bytearray(data), len(MAGIC)
    while at + 12 <= len(fixed):
        end = at + 8 + int.from_bytes(fixed[at : at + 4], "big")
        if end + 4 > len(fixed):
            break
        fixed[end : end + 4] = zlib.crc32(fixed[at + 4 : end]).to_bytes(4, "big")
        at = end + 4
    return bytes(fixed)


def with_harm_in(data: bytes, draw: st.DrawFn) -> bytes:
    """Return a zip archive in which one file is a pickle that runs code."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(out, "w") as forged:
        harmed = draw(st.sampled_from(archive.namelist()))
        for name in archive.namelist():
            content = pickle.dumps(Harm(HARMED), protocol=2) if name == harmed else archive.read(name)
            forged.writestr(name, content)
    return out.getvalue()


@st.composite
def mutations(draw, data: bytes) -> bytes:
    """Draw a file that differs from `data` in one place: bytes, a block, its end, or a value in a text."""
    kind = draw(st.sampled_from(("value", "byte", "end", "gap", "twice", "more", "zeros", "inside", "pickle")))
    if kind == "pickle" and data.startswith(ARCHIVE) and draw(st.booleans()):
        return with_harm_in(data, draw)
    if kind == "pickle":
        return pickle.dumps(Harm(HARMED), protocol=2)
    at = draw(st.integers(0, len(data) - 1))
    end = min(len(data), at + draw(st.integers(1, 64)))
    if kind == "value" and (places := list(TOKEN.finditer(data))):
        place = draw(st.sampled_from(places))
        return data[: place.start()] + draw(st.sampled_from(TOKENS)) + data[place.end() :]
    if kind == "inside" and data.startswith(MAGIC):
        return with_right_checksums(data[:at] + draw(st.binary(min_size=1, max_size=8)) + data[at + 1 :])
    changed = {
        "end": data[:at],
        "gap": data[:at] + data[end:],
        "twice": data[:end] + data[at:],
        "zeros": data[:at] + bytes(end - at) + data[end:],
    }
    if kind in changed:
        return changed[kind]
    return data[:at] + draw(st.binary(min_size=1, max_size=8)) + data[at + (kind != "more") :]


@pytest.fixture(scope="module")
def valid(tmp_path_factory):
    """Path and content of a valid file of each format."""
    made = {}
    for number, (name, (make, _)) in enumerate(FORMATS.items()):
        path = make(tmp_path_factory.mktemp(f"format{number}"))
        made[name] = path, path.read_bytes()
    return made


@pytest.mark.parametrize("name", FORMATS)
def test_the_files_are_valid_before_they_are_attacked(valid, name):
    path, data = valid[name]
    path.write_bytes(data)
    FORMATS[name][1](path)


def with_other_values(data: bytes, rng: random.Random) -> Iterator[bytes]:
    """Yield a text with each of its values, or MOST_VALUES of them, in turn replaced by each of TOKENS."""
    places = list(TOKEN.finditer(data))
    for place in rng.sample(places, min(MOST_VALUES, len(places))):
        for token in TOKENS:
            yield data[: place.start()] + token + data[place.end() :]


@only_in_make_hostile
@pytest.mark.parametrize("name", FORMATS)
def test_no_value_in_a_text_is_taken_for_what_it_is_not(valid, name, capfd):
    path, whole = valid[name]
    if b"\0" in whole:
        pytest.skip("is no text")
    for text in with_other_values(whole, rng_of(name)):
        path.write_bytes(text)
        count(name, "file")
        judge(lambda: FORMATS[name][1](path), capfd, path.name)


@pytest.mark.parametrize("name", FORMATS)
@given(data=st.data())
@many
def test_a_mutated_file_is_read_or_refused_in_one_line(valid, name, data, capfd):
    path, whole = valid[name]
    path.write_bytes(data.draw(mutations(whole)))
    count(name, "file")
    judge(lambda: FORMATS[name][1](path), capfd, path.name)
