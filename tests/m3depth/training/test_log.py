"""The log keeps the precision of its numbers, and a resumed run continues it after its checkpoint."""

import json
import sys

import numpy as np
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


def test_each_start_says_what_its_steps_come_from(tmp_path, monkeypatch) -> None:
    for step, steps in ((0, (1, 2, 3)), (2, (3,))):
        monkeypatch.setattr(
            sys, "orig_argv", ["/some/where/python3", "-m", "m3depth.train", "--out", "my runs", str(step)]
        )
        log = Log(tmp_path, step)
        log.start(step, seed=7, data="ab12", processes=2)
        for number in steps:
            log.write("train", number, {"loss": 1.0})
        log.close()
    starts = records(tmp_path, "start")
    assert [start["command"] for start in starts] == [f"python3 -m m3depth.train --out 'my runs' {n}" for n in (0, 2)]
    assert [start["step"] for start in starts] == [0, 2] and (starts[0]["seed"], starts[0]["data"]) == (7, "ab12")
    assert [start["processes"] for start in starts] == [2, 2]
    assert starts[0]["numpy"] == np.__version__ and "commit" in starts[0]
    assert [record["step"] for record in records(tmp_path, "train")] == [1, 2, 3]


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


def test_a_path_that_tensorboard_cannot_write_is_logged_without_it(tmp_path, monkeypatch) -> None:
    """In a locale without UTF-8, it encodes the path and fails."""

    def writer(folder: str, **_) -> None:
        raise UnicodeEncodeError("utf-8", folder, 0, 1, "surrogates not allowed")

    monkeypatch.setattr("torch.utils.tensorboard.SummaryWriter", writer)
    log = Log(tmp_path, 0)
    log.write("train", 1, {"loss": 1.0})
    log.close()
    assert len(records(tmp_path, "train")) == 1
