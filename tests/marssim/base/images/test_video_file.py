import resource
import signal

import cv2
import numpy as np
import pytest

from marssim.base.images.video_file import countable_rate, written_video

SIZE = (320, 240)


def add_noise(write, frames):
    rng = np.random.default_rng(0)
    for _ in range(frames):
        write(rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8))


def test_a_video_holds_its_frames(tmp_path):
    grey = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    with written_video(tmp_path / "v.mp4", SIZE, 10.0) as write:
        for value in (0, 10, 20):
            write(grey + np.uint8(value))
    video = cv2.VideoCapture(str(tmp_path / "v.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 10
    levels = []
    while (read := video.read())[0]:
        levels.append(read[1].mean())
    assert levels == pytest.approx([90, 100, 110], abs=4)
    assert [path.name for path in tmp_path.iterdir()] == ["v.mp4"]


@pytest.mark.parametrize(("rate", "countable"), [(1e3 / 15, 66.67), (100.1234, 100.12), (59.94, 59.94), (1e6, 65535)])
def test_a_rate_that_mpeg_4_cannot_count_is_rounded(tmp_path, rate, countable):
    assert countable_rate(rate) == countable
    with written_video(tmp_path / "v.mp4", SIZE, rate) as write:
        add_noise(write, 2)
    assert cv2.VideoCapture(str(tmp_path / "v.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(countable, rel=1e-3)


def test_a_video_without_frames_and_one_of_a_failed_block(tmp_path):
    with written_video(tmp_path / "v.mp4", SIZE, 10.0):
        pass
    before = (tmp_path / "v.mp4").read_bytes()
    with pytest.raises(KeyboardInterrupt), written_video(tmp_path / "v.mp4", SIZE, 10.0) as write:
        add_noise(write, 3)
        raise KeyboardInterrupt
    assert (tmp_path / "v.mp4").read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_frames_that_do_not_fit_on_the_disk_are_said(tmp_path):
    """OpenCV only warns."""
    limits, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
        with (
            pytest.raises(OSError, match=rf"^{tmp_path}/v\.mp4: only \d+ of 30 frames .* is the disk full\?$"),
            written_video(tmp_path / "v.mp4", SIZE, 10.0) as write,
        ):
            add_noise(write, 30)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(OSError), written_video(tmp_path / "none" / "v.mp4", SIZE, 10.0):
        raise AssertionError
