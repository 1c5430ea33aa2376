"""Labels that are read in one pass: each of these would take hours if what does not match were tried again."""

import pytest

from marssim.base.calibration.pds3_label import read_pds3

LONG = 2_000_000  # [bytes] half of what is read of a label
IMAGE = "OBJECT = IMAGE\r\n LINES = 4\r\n LINE_SAMPLES = 6\r\nEND_OBJECT = IMAGE\r\n"


@pytest.mark.parametrize("part", ["a", "A=(", "A = ( ", "A='", "A ", "A\n"])
def test_a_label_of_vicar(tmp_path, part):
    text = f"NL=4 NS=6 RECSIZE=6 {part * (LONG // len(part))}"
    begin = f"LBLSIZE={len(text) + 16:<8}"
    (tmp_path / "a.vic").write_text(begin + text)
    assert read_pds3(tmp_path / "a.vic").size == (6, 4)


@pytest.mark.parametrize(
    "part", ["/* ", "a", "A ", " ", 'A = "\n', "A = (\n", "A = {\n", 'A = ("\n', "A = ((\n", "A = \n"]
)
def test_a_label_of_pds3(tmp_path, part):
    text = f"PDS_VERSION_ID = PDS3\r\n{IMAGE}X = 1 {part * (LONG // len(part))}"
    (tmp_path / "a.lbl").write_text(f"{text}x\r\nEND\r\n")
    assert read_pds3(tmp_path / "a.lbl").size == (6, 4)


def test_comments_are_left_out(tmp_path):
    image = IMAGE.replace("LINES = 4", "LINES = 4 /* rows */").replace("END_OBJECT", "/* LINES = 5 \r\n */END_OBJECT")
    (tmp_path / "a.lbl").write_text(f"PDS_VERSION_ID = PDS3 /* 3 */\r\n{image}END\r\n /* no end")
    assert read_pds3(tmp_path / "a.lbl").size == (6, 4)
    (tmp_path / "b.lbl").write_text(f'PDS_VERSION_ID = PDS3\r\nNOTE = "see /* of it"\r\n{image}/* c */\r\nEND\r\n')
    assert read_pds3(tmp_path / "b.lbl").size == (6, 4)
