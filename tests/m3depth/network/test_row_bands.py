import pytest
import torch
from small_network import SMALL

from m3depth.network import row_bands
from m3depth.network.model import M3Depth
from m3depth.network.row_bands import by_rows


@pytest.mark.parametrize("cached", [1, 500, 10**9])
def test_bands_give_what_all_rows_at_once_give(monkeypatch, cached: int) -> None:
    monkeypatch.setattr(row_bands, "BAND_ON_CPU", cached)
    calls: list[int] = []

    def doubled(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        calls.append(x.shape[-2])
        return (x + y).repeat_interleave(2, -2)

    x, y = torch.randn(2, 3, 11, 20), torch.randn(2, 1, 11, 20)
    with torch.inference_mode():
        assert torch.equal(by_rows(doubled, x, y), (x + y).repeat_interleave(2, -2))
    assert sum(calls) == 11 and (len(calls) > 1) == (cached < 1000)


def test_a_gpu_computes_large_maps_whole() -> None:
    """Each small band would cost it the start of an operation."""
    x = torch.empty(1, 64, 512, 768, device="meta")
    calls: list[int] = []
    with torch.inference_mode():
        by_rows(lambda rows: calls.append(rows.shape[-2]) or 2 * rows, x)
    assert calls == [512]


def test_what_is_trained_is_computed_at_once(monkeypatch) -> None:
    monkeypatch.setattr(row_bands, "BAND_ON_CPU", 1)
    x = torch.randn(1, 1, 8, 8, requires_grad=True)
    calls: list[int] = []
    by_rows(lambda rows: calls.append(rows.shape[-2]) or 2 * rows, x).sum().backward()
    assert calls == [8] and x.grad is not None


def test_the_network_gives_the_same_maps_in_bands(monkeypatch) -> None:
    torch.manual_seed(0)
    network = M3Depth(SMALL).eval()
    assert network.fine is not None
    torch.nn.init.normal_(network.fine.last.weight, std=0.05)
    left, right = torch.rand(2, 1, 3, 48, 96)
    camera = torch.tensor([[60.0, 60.0, 47.5, 23.5]])
    results = []
    for cached in (10**9, 2000):
        monkeypatch.setattr(row_bands, "BAND_ON_CPU", cached)
        with torch.inference_mode():
            results.append(network(left, right, camera))
    for name in ("disparity", "normal", "confidence", "sky"):
        torch.testing.assert_close(*(getattr(out, name) for out in results))
