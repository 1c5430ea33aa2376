import json
from pathlib import Path

import pytest

import envs.make_suite
from envs.make_suite import main
from envs.suites.held_out import published_digest
from envs.suites.suite import load_suite

SECRET = "correct horse battery staple"


@pytest.fixture
def passphrase(tmp_path):
    path = tmp_path / "secret.txt"
    path.write_text(SECRET + "\n")
    return str(path)


def test_a_held_out_split_is_drawn_from_its_passphrase(small_suite, passphrase, tmp_path, capsys):
    held_out = ["--held-out", str(small_suite), "--passphrase-file", passphrase, "--courses"]
    assert main([*held_out, "1"]) == 0
    digest = capsys.readouterr().out.strip()
    assert digest == published_digest(load_suite(str(small_suite)), 1, SECRET)
    out = tmp_path / "held_out.json"
    draw = ["--out", str(out), "--published"]
    assert main([*held_out, "1", *draw, "0" * 64]) == 2 and not out.exists()
    assert "--published must be the digest of this passphrase, of 1 course and of " in capsys.readouterr().err
    assert main([*held_out, "2", *draw, digest]) == 2 and not out.exists()
    assert main([*held_out, "1", *draw, digest]) == 0
    drawn, suite = load_suite(str(out)), load_suite(str(small_suite))
    assert drawn.name == "small-v1-held-out" and set(drawn.splits) == {"held_out"}
    assert drawn.conditions == suite.conditions and drawn.drive == suite.drive
    seeds = {episode["seed"] for episode in drawn.episodes.values()}
    assert len(seeds) == 1 and not seeds & {episode["seed"] for episode in suite.episodes.values()}


def test_a_held_out_split_is_driven_as_its_suite(small_suite, passphrase, tmp_path, monkeypatch):
    content = json.loads(small_suite.read_text())
    content["drive"].update(renderer="scan", slip="sand")
    other = tmp_path / "other-v1.json"
    other.write_text(json.dumps(content))
    calls = []
    monkeypatch.setattr(envs.make_suite, "make_suite", lambda *a, **k: calls.append(k) or {"suite": a[0]})
    published = published_digest(load_suite(str(other)), 1, SECRET)
    envs.make_suite.write_suite(
        envs.make_suite.MakeSuiteConfig(
            tmp_path / "a.json", courses=1, held_out=str(other), passphrase_file=Path(passphrase), published=published
        )
    )
    assert calls[0]["drive"] == content["drive"]


def test_a_passphrase_that_is_no_text_is_named(small_suite, tmp_path, capsys):
    (tmp_path / "secret").write_bytes(b"\xff\xfe secret of no encoding")
    assert main(["--held-out", str(small_suite), "--passphrase-file", str(tmp_path / "secret")]) == 2
    assert capsys.readouterr().err == f"error: --passphrase-file {tmp_path / 'secret'}: is no text in UTF-8\n"


def test_a_short_passphrase_is_named_by_its_file(small_suite, tmp_path, capsys):
    secret = tmp_path / "secret"
    secret.write_text("x")
    assert main(["--held-out", str(small_suite), "--passphrase-file", str(secret)]) == 2
    assert capsys.readouterr().err == f"error: --passphrase-file {secret}: must hold 16 characters or more, got 1\n"


def test_the_mark_that_some_editors_put_first_is_no_part_of_a_passphrase(small_suite, tmp_path, capsys):
    digests = []
    for encoding in ("utf-8", "utf-8-sig"):
        (tmp_path / encoding).write_text("correct horse battery", encoding=encoding)
        assert main(["--held-out", str(small_suite), "--passphrase-file", str(tmp_path / encoding)]) == 0
        digests.append(capsys.readouterr().out)
    assert digests[0] and digests[0] == digests[1]


def test_a_suite_that_is_not_in_the_package_is_named_by_its_flag(passphrase, capsys):
    assert main(["--held-out", "nope", "--passphrase-file", passphrase]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: --held-out 'nope' is unknown; the package has ") and error.count("\n") == 1


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ([], "--name must name the new suite, with its version"),
        (["--name", "marsnav-v1"], "--name marsnav-v1: the package has a suite of this name; choose another"),
    ],
)
def test_a_new_suite_needs_a_name_of_its_own(tmp_path, capsys, args, message):
    assert main(["--out", str(tmp_path / "a.json"), *args]) == 2
    assert capsys.readouterr().err == f"error: {message}\n"


def test_a_suite_is_never_replaced(tmp_path, capsys):
    out = tmp_path / "mine-v1.json"
    out.write_text("{}")
    assert main(["--out", str(out), "--name", "mine-v1"]) == 2
    assert f"--out {out}: exists" in capsys.readouterr().err and out.read_text() == "{}"


def test_a_place_that_cannot_hold_the_suite_is_named_before_anything_is_drawn(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("envs.make_suite.make_suite", lambda *_, **__: pytest.fail("it draws"), raising=False)
    (tmp_path / "file").write_text("")
    out = tmp_path / "file/mine.json"
    assert main(["--name", "mine-v1", "--courses", "1", "--condition", "clear", "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"error: --out {out}: there is a file in the place of its folder\n"


def test_a_new_suite_has_the_conditions_asked_for(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(envs.make_suite, "make_suite", lambda *a, **k: calls.append(a) or {"suite": a[0]})
    monkeypatch.setattr(envs.make_suite, "load_suite", lambda name: pytest.fail("not needed"))
    file = envs.make_suite.write_suite(
        envs.make_suite.MakeSuiteConfig(tmp_path / "a.json", "mine-v1", courses=3, condition=("clear", "storm"))
    )
    ((name, splits, conditions),) = calls
    assert name == "mine-v1" and list(conditions) == ["clear", "storm"]
    assert {split: values["courses"] for split, values in splits.items()} == {"dev": 3, "test": 3}
    assert json.loads(file.read_text()) == {"suite": "mine-v1"}


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ([], "--out must name the file"), (["--held-out", "a"], "--held-out and --passphrase-file need each other"),
        (["--published", "a", "--out", "b.json"], "--published needs --held-out"),
        (["--held-out", "a", "--passphrase-file", "f", "--out", "b.json"], "--out needs --published"),
        (["--held-out", "a", "--passphrase-file", "f", "--name", "b"], "--name is for a new suite"),
        (["--held-out", "a", "--passphrase-file", "f", "--condition", "clear"], "--condition is for a new suite"),
        (["--out", "b.json", "--name", "a/b"], "--name must be a name of letters, digits, _, . and -, got 'a/b'"),
        (["--out", "b"], "--out b: the file of a suite must end in .json"),
        (["--out", "b.json", "--courses", "0"], "--courses must be at least 1"),
        (["--out", "b.json", "--condition", "strom"], "--condition 'strom' is unknown (did you mean storm?)"),
    ],
)  # fmt: skip
def test_flags_that_do_not_fit_are_refused(flags, message, capsys):
    assert main(flags) == 2
    assert message in capsys.readouterr().err
