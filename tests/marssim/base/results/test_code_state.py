"""The digest of the source code, and the files of modules."""

import json

from marssim.base.results.code_state import source_digest, source_file


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
