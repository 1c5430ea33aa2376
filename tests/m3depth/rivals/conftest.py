import numpy as np
import pytest
import torch

from m3depth.training import loop, validation


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.manual_seed(3)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch) -> None:
    """The pictures of a training take longer than its one step; tests of training and figures draw them."""
    monkeypatch.setattr(validation, "pairs_figure", lambda examples, path: np.zeros((8, 8, 3), np.uint8))
    monkeypatch.setattr(loop, "save_curves", lambda out: None)
