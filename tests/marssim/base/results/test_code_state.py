"""The digest of the source code, its commit, and the files of modules."""

import json
import subprocess

import pytest

from marssim.base.results.code_state import commit, joined_versions, processor, source_digest, source_file, versions


def test_the_digest_changes_with_any_source_and_only_then(tmp_path, monkeypatch):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("")
    (tmp_path / "two" / "a.py").write_text("x = 1")
    monkeypatch.syspath_prepend(tmp_path)

    def digest():
        return source_digest.__wrapped__(("one", "two"))

    first = digest()
    (tmp_path / "two" / "notes.txt").write_text("no source")
    assert digest() == first and len(first) == 12
    (tmp_path / "two" / "a.py").write_text("x = 2")
    second = digest()
    (tmp_path / "two" / "a.py").rename(tmp_path / "two" / "b.py")
    assert len({first, second, digest()}) == 3


def test_the_file_of_a_module_and_of_what_has_none():
    assert str(source_file("json")) == json.__file__
    assert source_file("sys") is None and source_file("no_such_module_at_all") is None


def test_the_commit_is_that_of_tracked_sources_and_says_when_they_differ(tmp_path, monkeypatch):
    package = tmp_path / "checkout" / "some_package"
    package.mkdir(parents=True)
    source = package / "__init__.py"
    source.write_text("")
    monkeypatch.syspath_prepend(package.parent)

    def git(*words):
        who = ("-c", "user.name=x", "-c", "user.email=x@example.org")
        return subprocess.run(
            ["git", "-C", str(package.parent), *who, *words], check=True, capture_output=True, text=True
        ).stdout.strip()

    def found():
        return commit.__wrapped__("some_package")

    assert found() is None  # no checkout
    git("init", "-q")
    (package.parent / "other").write_text("")
    git("add", "other")
    git("commit", "-qm", "without the package")
    assert found() is None  # as a package that is installed below another project's checkout
    git("add", ".")
    git("commit", "-qm", "with it")
    git("tag", "-am", "a release", "v1")
    assert found() == git("rev-parse", "--short=12", "HEAD")
    source.write_text("x = 1")
    assert found() == git("rev-parse", "--short=12", "HEAD") + "-dirty"
    monkeypatch.setenv("PATH", str(tmp_path))
    assert found() is None  # no git


def test_versions_name_the_processor(monkeypatch):
    assert versions()["processor"] == processor()
    monkeypatch.setattr("pathlib.Path.read_text", lambda *_, **__: "processor\t: 0\nmodel name\t: Mars CPU 3: x\n")
    assert processor() == "Mars CPU 3: x"
    monkeypatch.setattr("pathlib.Path.read_text", lambda *_, **__: "processor\t: 0\n")
    assert processor() is None

    def missing(*_, **__):
        raise FileNotFoundError

    monkeypatch.setattr("pathlib.Path.read_text", missing)
    monkeypatch.setattr("platform.processor", lambda: "arm")
    assert processor() == "arm"


def test_joined_versions_are_those_in_common_or_all():
    first, second, third = {"python": "3.11", "cpus": 2, "torch": "2.1"}, {"python": "3.11", "cpus": 4}, {}
    assert joined_versions([first, first]) == first
    both = {"python": "3.11", "cpus": [2, 4], "torch": ["2.1", None]}
    assert joined_versions([first, second]) == joined_versions([both, second, first]) == both
    assert joined_versions([both, third]) == {"python": ["3.11", None], "cpus": [2, 4, None], "torch": ["2.1", None]}
    assert joined_versions([third]) == joined_versions([]) == {}


def test_versions_name_the_commit():
    assert versions()["commit"] == commit("marssim")
    with pytest.raises(AssertionError):
        commit("no_such_package_at_all")
