"""The log keeps the precision of its numbers, and a resumed run continues it after its checkpoint."""

import json

import pytest

from m3depth.training.log import Log, records
from marssim.base.files.json_file import DatasetError


def test_small_numbers_keep_their_digits(tmp_path) -> None:
    log = Log(tmp_path, 0)
    log.write("train", 1, {"lr": 3.141592653e-6, "loss": 1234.56789, "normal": float("nan")})
    log.close()
    record = json.loads((tmp_path / "log.jsonl").read_text())
    assert record == {"kind": "train", "step": 1, "lr": 3.14159e-6, "loss": 1234.57, "normal": None}
    assert records(tmp_path, "train") == [record] and records(tmp_path, "val") == []


def test_what_came_after_the_checkpoint_is_logged_again(tmp_path) -> None:
    log = Log(tmp_path, 0)
    for step in (1, 2, 3):
        log.write("train", step, {"loss": float(step)})
    log.close()
    path = tmp_path / "log.jsonl"
    path.write_text(path.read_text() + '{"kind": "train", "st')  # cut off
    assert [record["step"] for record in records(tmp_path, "train")] == [1, 2, 3]
    again = Log(tmp_path, 2)
    again.write("train", 3, {"loss": 5.0})
    again.close()
    assert [(r["step"], r["loss"]) for r in records(tmp_path, "train")] == [(1, 1.0), (2, 2.0), (3, 5.0)]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"\0\0\0}\n", "is not JSON"), (b"\n", "is not JSON"), (b'["kind", {}]\n', "not a JSON object"),
        (b'{"kind": "train"}\n', "is not a record"), (b'{"kind": "val", "step": "2"}\n', "is not a record"),
        (b'{"kind": "train", "step": 2, "loss": "low"}\n', "is not a record"), (b"[" * 10**5 + b"}\n", "deep"),
    ],
)  # fmt: skip
def test_a_line_that_is_no_record_is_named(tmp_path, line, says) -> None:
    """As a power loss may leave one, with zeros in it."""
    lines = [b'{"kind": "train", "step": %d, "loss": 1.5}\n' % step for step in (1, 3)]
    (tmp_path / "log.jsonl").write_bytes(lines[0] + line + lines[1])
    for read in (lambda: records(tmp_path, "train"), lambda: Log(tmp_path, 3)):
        with pytest.raises(DatasetError, match=rf"log\.jsonl, line 2: .*{says}"):
            read()
    assert (tmp_path / "log.jsonl").read_bytes() == lines[0] + line + lines[1]
