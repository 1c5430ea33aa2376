import cv2
import numpy as np
import pytest

from m3depth.prediction.sources.video_frames import EndOfVideo, VideoFrames


def write_video(path, frames, rate=8.0) -> None:
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, (width, height))
    for frame in frames:
        writer.write(frame)
    writer.release()


def grey(level: int, width: int = 64) -> np.ndarray:
    return np.full((48, width, 3), level, np.uint8)


def test_two_videos_give_the_frames_of_both_eyes_and_skip_some(tmp_path):
    for name, offset in (("l", 0), ("r", 100)):
        write_video(tmp_path / f"{name}.avi", [grey(10 * i + offset) for i in range(5)])
    video = VideoFrames([tmp_path / "l.avi", tmp_path / "r.avi"])
    assert (video.count, video.rate) == (5, 8.0)
    for number in (0, 2, 4):
        left, right = video.read(number)
        assert abs(int(left.mean()) - 10 * number) <= 2 and abs(int(right.mean()) - 10 * number - 100) <= 2
    with pytest.raises(EndOfVideo):
        video.read(5)


def test_one_video_has_the_left_eye_in_its_left_half(tmp_path):
    write_video(tmp_path / "both.avi", [np.concatenate([grey(40), grey(160)], axis=1)])
    left, right = VideoFrames([tmp_path / "both.avi"]).read(0)
    assert left.shape == right.shape == (48, 64, 3) and abs(left.mean() - 40) < 3 and abs(right.mean() - 160) < 3


def test_what_is_no_video_of_two_eyes_is_named(tmp_path, capfd):
    (tmp_path / "text.mp4").write_text("no video")
    write_video(tmp_path / "a.avi", [grey(1)])
    write_video(tmp_path / "b.avi", [grey(1, 80)])
    with pytest.raises(ValueError, match=r"text.mp4: is not a video"):
        VideoFrames([tmp_path / "text.mp4"])
    assert "WARN" not in capfd.readouterr().err
    with pytest.raises(ValueError, match=r"a.avi is 64 x 48, .*b.avi is 80 x 48: both eyes must have the same size"):
        VideoFrames([tmp_path / "a.avi", tmp_path / "b.avi"])
    write_video(tmp_path / "fast.avi", [grey(1)], rate=10.0)
    with pytest.raises(ValueError, match=r"a.avi has 8 frames a second, .*fast.avi has 10: frames of one number are"):
        VideoFrames([tmp_path / "a.avi", tmp_path / "fast.avi"])
    with pytest.raises(FileNotFoundError, match=r"c.avi: no such video"):
        VideoFrames([tmp_path / "c.avi"])
