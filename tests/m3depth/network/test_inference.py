import pytest

from m3depth.network.inference import working_sizes
from marssim.base.camera import NATECAM


@pytest.mark.parametrize(
    ("width", "nearest", "max_pixels", "widths"),
    [
        (512, 0.84, None, [512]),
        (1024, 0.84, None, [513, 1024]),
        (2048, 0.84, None, [513, 2048]),
        (8192, 0.84, None, [513, 2050, 8192]),
        (2048, 0.84, 1024 * 1024, [513, 1024]),
        (2048, 0.84, 256 * 256, [256]),
        (1024, 1.6, None, [978]),  # hardly larger: not worth another pass
        (1024, 3.0, None, [1024]),
    ],
)
def test_sizes_end_at_the_pixels_of_the_images(
    width: int, nearest: float, max_pixels: int | None, widths: list[int]
) -> None:
    sizes = working_sizes(NATECAM.resized(width, width), 192.0, nearest, max_pixels)
    assert [size[1] for size in sizes] == widths and all(rows == columns for rows, columns in sizes)


def test_networks_without_refinement_work_at_one_size() -> None:
    assert working_sizes(NATECAM.resized(2048, 2048), 192.0, 0.84, refines=False) == [(513, 513)]
