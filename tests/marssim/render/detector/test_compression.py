import numpy as np

from marssim.render.detector.compression import sent


def test_a_lower_quality_changes_more_and_colours_keep_their_order():
    rng = np.random.default_rng(0)
    image = np.clip(rng.normal([150, 110, 70], 20, (64, 80, 3)), 0, 255).astype(np.uint8)
    errors = [np.abs(sent(image, quality).astype(int) - image).mean() for quality in (95, 75, 30)]
    assert 0 < errors[0] < errors[1] < errors[2]
    assert np.abs(sent(image, 75).mean(axis=(0, 1)) - image.mean(axis=(0, 1))).max() < 2
    assert sent(image, 75).shape == image.shape and np.array_equal(sent(image, 75), sent(image, 75))


def test_colours_lose_every_other_column_and_no_row():
    red = np.zeros((32, 32), bool)
    red[::2] = True
    rows = np.where(red[..., None], [150, 110, 110], [110, 110, 150]).astype(np.uint8)
    columns = rows.swapaxes(0, 1)
    kept = [np.ptp(sent(image, 98).astype(int)[..., 0] - sent(image, 98)[..., 2]) for image in (rows, columns)]
    assert kept[0] > 60 and kept[1] < 15
