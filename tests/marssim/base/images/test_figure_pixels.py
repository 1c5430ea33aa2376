import numpy as np
from matplotlib.figure import Figure

from marssim.base.images.figure_pixels import figure_pixels


def test_a_figure_becomes_pixels_of_its_size_and_colour():
    figure = Figure(figsize=(2, 1), dpi=50, facecolor="#ff8000")
    pixels = figure_pixels(figure)
    assert pixels.shape == (50, 100, 3) and pixels.dtype == np.uint8
    assert (pixels == [255, 128, 0]).all()
