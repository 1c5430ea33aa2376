"""The picture of the refinement steps, and what the record says of them."""

import numpy as np
import pytest

from m3depth.prediction.pictures.figure import LINE
from m3depth.prediction.pictures.step_figure import COLUMNS, change_colours, steps_picture, steps_record
from m3depth.stereo.prediction import StepMap


def maps_of(*disparities: float, size: tuple[int, int] = (200, 300)) -> list[StepMap]:
    """Constant maps, the upper left pixel unknown."""
    maps = [np.full(size, disparity, np.float32) for disparity in disparities]
    for one in maps:
        one[0, 0] = np.nan
    return [StepMap(f"step {n}", size, one) for n, one in enumerate(maps, start=1)]


def test_the_record_has_the_mean_change_of_each_step():
    steps = maps_of(10.0, 12.5, 12.25)
    assert [entry["mean_change_px"] for entry in steps_record(steps)] == [None, 2.5, 0.25]
    assert steps_record(steps)[1] | {"mean_change_px": 0} == {"name": "step 2", "size": [200, 300], "mean_change_px": 0}
    unknown = [step._replace(disparity=step.disparity * np.nan) for step in steps]
    assert [entry["mean_change_px"] for entry in steps_record(unknown)] == [None, None, None]


def test_nearer_is_blue_farther_is_red_and_no_change_is_white():
    colours = change_colours(np.array([[0.0, 0.5, 3.0, -1.0, np.nan]]))[0].tolist()
    assert colours == [[255, 255, 255], [127, 127, 255], [0, 0, 255], [255, 0, 0], [0, 0, 0]]


@pytest.mark.parametrize(("count", "columns", "rows"), [(1, 2, 1), (3, 3, 1), (6, COLUMNS, 2)])
def test_the_depth_of_each_step_stands_above_its_change(count, columns, rows):
    steps = maps_of(*(10.0 + n for n in range(count)))
    picture = steps_picture(steps, 100.0, 0.0, (5.0, 15.0))
    panel = 2 * (200 + LINE)
    assert abs(picture.shape[1] - columns * 300) < 30 and abs(picture.shape[0] - rows * panel) < 50 * rows
    assert not picture[LINE, 0].any()  # the unknown pixel
    depth, change = picture[LINE + 100, 150], picture[2 * LINE + 300, 150]
    assert np.ptp(depth) > 50
    assert (change == 255).all()  # before the first map there is none
    if count > 1:
        assert (picture[2 * LINE + 300, 306 + 150] == [0, 0, 255]).all()


def test_sky_is_grey_and_a_common_disparity_brings_the_rest_nearer():
    place = LINE + 100, 150
    for common in (0.0, 10.0):
        assert (steps_picture(maps_of(0.0), 100.0, common, (5.0, 15.0))[place] == 90).all()
        assert (steps_picture(maps_of(-0.5 - common), 100.0, common, (5.0, 15.0))[place] == 90).all()  # overshoots it
    apart = steps_picture(maps_of(5.0), 100.0, 10.0, (5.0, 15.0))[place]
    assert (apart == steps_picture(maps_of(15.0), 100.0, 0.0, (5.0, 15.0))[place]).all()
    assert (apart != steps_picture(maps_of(5.0), 100.0, 0.0, (5.0, 15.0))[place]).any()
