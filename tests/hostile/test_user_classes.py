"""Classes of users that raise, exit, hang, return nonsense or change their input end in a result or in their name."""

import json
import os
import signal
import time

import pytest
from oracle import count, only_in_make_hostile
from user_classes import EXITING, NONSENSE, RAISING

from envs.evaluate import main as drive
from m3depth.evaluate import main as evaluate
from m3depth.predict import main as predict
from marssim.base.command.run import describe

pytestmark = only_in_make_hostile
DRIVES = "--dynamics kinematic --goal-distance 3 --k 0.01 --no-videos --episodes 1"
ROLES = {  # command, and its flags without --out; {name} is the class
    "m3depth.evaluate": (
        evaluate,
        "--data {data} --split all --limit 1 --weights {weights} --runtime pytorch --baselines none --estimator {name}",
    ),
    "m3depth.predict": (predict, "{data} --estimator {name} --write depth"),
    "envs.evaluate driver": (drive, "--driver {name} --perception ground_truth " + DRIVES),
    "envs.evaluate perception": (drive, "--driver straight --perception {name} " + DRIVES),
}
LONGEST = 60  # [s] in which a signal must end a class that hangs


def line(role, name, inputs, out) -> list[str]:
    flags = ROLES[role][1].split()
    return ["--out", str(out), *(word.format(name=f"user_classes:{name}", **inputs) for word in flags)]


def run(role, name, inputs, out, capsys) -> tuple[int, str]:
    """Return the exit code and what is printed to stderr; the message of a traceback counts as printed, with code 1."""
    count(role, "user class")
    capsys.readouterr()
    try:
        code = ROLES[role][0](line(role, name, inputs, out))
    except Exception as error:  # a bug of the class, whose traceback Python prints
        return 1, describe(error)
    return code, capsys.readouterr().err


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("name", (*RAISING, "RaisesWhenMade"))
def test_an_exception_ends_the_command_with_a_message_of_the_class(role, name, inputs, tmp_path, capsys):
    code, error = run(role, name, inputs, tmp_path / "out", capsys)
    assert code in (1, 2) and "mine" in error, error
    if code == 2:
        assert error.count("error: ") == 1 and (name in error or "memory" in error), error


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("name", EXITING)
def test_an_exit_is_no_success(role, name, inputs, tmp_path, capsys):
    code, error = run(role, name, inputs, tmp_path / "out", capsys)
    assert code == 2 and "user_classes.py, line " in error and "sys.exit" in error, error


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_is_refused_by_the_name_of_the_class_or_is_unknown(role, name, inputs, tmp_path, capsys):
    code, error = run(role, name, inputs, tmp_path / "out", capsys)
    assert code in (0, 2), error
    if code == 2:
        assert name in error and error.strip().splitlines()[-1].startswith("error: "), error


@pytest.mark.parametrize("role", ROLES)
def test_what_a_class_does_to_its_input_changes_nothing_else(role, inputs, tmp_path, capsys):
    code, error = run(role, "ChangesItsInput", inputs, tmp_path, capsys)
    assert code == 0, error
    if role == "m3depth.evaluate":  # a method is run twice on its first pair, so what it blackens counts for itself too
        alone = [
            word.replace("user_classes:ChangesItsInput", "sgbm") for word in line(role, "ChangesItsInput", inputs, "")
        ]
        both, folders = [*line(role, "ChangesItsInput", inputs, ""), "sgbm"], (tmp_path / "alone", tmp_path / "both")
        for arguments, folder in zip((alone, both), folders, strict=True):
            assert evaluate([arguments[0], str(folder), *arguments[2:]]) == 0
        expected, actual = (json.loads((folder / "results.json").read_text())["methods"] for folder in folders)
        assert actual["ChangesItsInput"]["depth"] == actual["SGBM"]["depth"] == expected["SGBM"]["depth"]


@pytest.mark.parametrize("role", ROLES)
def test_a_signal_ends_a_class_that_hangs(role, server, inputs, tmp_path):
    out = tmp_path / "out"
    pid, folder = server.start(role.split()[0], line(role, "Hangs", inputs, out))
    began = time.monotonic()
    while not (out / ".lock").exists() and time.monotonic() - began < LONGEST:
        time.sleep(0.1)
    time.sleep(2)
    began = time.monotonic()
    for _ in range(2):  # the first one lets a command finish the pair at work
        os.kill(pid, signal.SIGTERM)
        time.sleep(1)
    ended = server.wait(pid, folder)
    count(role, "user class")
    assert ended.code in (130, -signal.SIGTERM) and "Traceback" not in ended.stderr, ended.stderr
    assert time.monotonic() - began < LONGEST
