import cv2
import numpy as np

from m3depth.prediction.files import FIGURE
from m3depth.prediction.overview import VIDEO, write_video


def test_a_video_of_pictures_with_odd_sides_is_one_pixel_smaller(tmp_path) -> None:
    """Most programs play no other MPEG-4."""
    for name, shape in (("a", (45, 67)), ("b", (90, 134))):
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / FIGURE), np.full((*shape, 3), 130, np.uint8))
    write_video(tmp_path, ["a", "b"], 5.0)
    video = cv2.VideoCapture(str(tmp_path / VIDEO))
    frames = [video.read()[1] for _ in range(2)]
    assert [frame.shape for frame in frames] == [(44, 66, 3)] * 2 and not video.read()[0]
    assert all(abs(float(frame.mean()) - 130) < 3 for frame in frames)
