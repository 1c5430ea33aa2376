"""What the message of an error begins with."""

from pathlib import Path

import pytest

from marssim.base.calibration.fields import message_in, read_in


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("field K1 is missing", "f and g: field K1 is missing"),  # it begins with f, as the name of the file is
        ("g: field K1 is missing", "g: field K1 is missing"),
        ("f and g: field K1 is missing", "f and g: field K1 is missing"),
    ],
)
def test_files_are_named_once(message, expected):
    assert message_in([Path("f"), Path("g")], ValueError(message)) == expected


def test_an_error_of_a_reader_begins_with_its_file():
    with pytest.raises(ValueError, match=r"^a\.yml: invalid literal for int"):
        read_in(Path("a.yml"), int, "many")
    assert read_in("a.yml", int, "12", base=8) == 10
