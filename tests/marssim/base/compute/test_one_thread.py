import os
import sys
from types import SimpleNamespace

import cv2
import pytest

from marssim.base.compute import one_thread


@pytest.fixture
def threads(monkeypatch):
    """Numbers of threads that PyTorch was given."""
    given = []
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(set_num_threads=given.append, get_num_threads=lambda: 2))
    monkeypatch.delenv(one_thread.THREADS, raising=False)
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    yield given
    cv2.setNumThreads(before)


@pytest.fixture
def as_worker(monkeypatch):
    monkeypatch.setattr(one_thread, "parent_process", SimpleNamespace)


def test_a_worker_computes_in_one_thread(threads, as_worker):
    one_thread.one_thread_in_workers()
    assert cv2.getNumThreads() == 1 and threads == [1] and one_thread.THREADS not in os.environ


def test_a_worker_that_imports_torch_later_does_too(threads, as_worker, monkeypatch):
    monkeypatch.delitem(sys.modules, "torch")
    one_thread.one_thread_in_workers()
    assert cv2.getNumThreads() == 1 and os.environ.pop(one_thread.THREADS) == "1"


def test_the_user_decides_where_he_has_set_a_number(threads, as_worker, monkeypatch):
    monkeypatch.setenv(one_thread.THREADS, "2")
    one_thread.one_thread_in_workers()
    assert cv2.getNumThreads() == 2 and threads == []


def test_the_main_process_keeps_its_threads(threads):
    one_thread.one_thread_in_workers()
    assert cv2.getNumThreads() == 2 and threads == [] and one_thread.THREADS not in os.environ


def test_a_block_computes_in_one_thread_and_leaves_the_number_as_it_was(threads, monkeypatch):
    with pytest.raises(KeyError), one_thread.one_thread():
        assert cv2.getNumThreads() == 1 and threads == [1]
        raise KeyError
    assert cv2.getNumThreads() == 2 and threads == [1, 2]
    monkeypatch.delitem(sys.modules, "torch")
    with one_thread.one_thread():
        assert cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == 2


@pytest.mark.parametrize(
    ("of_opencv", "of_user", "several"), [(2, None, True), (1, None, False), (2, "1", False), (2, "2", True)]
)
def test_several_threads_are_used_unless_one_is_asked_for(threads, monkeypatch, of_opencv, of_user, several):
    cv2.setNumThreads(of_opencv)
    if of_user:
        monkeypatch.setenv(one_thread.THREADS, of_user)
    assert one_thread.several_threads() is several
