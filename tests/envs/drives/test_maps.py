import pytest

from envs.drives.episodes import EpisodeRecord
from envs.drives.maps import plot_maps

DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.1, slope=5", episode=0, outcome="goal", steps=3, distance=0.5,
    start_distance=3.0, shortest=3.0, path_length=3.5, min_clearance=1.0, max_tilt_deg=4.0, reward=12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[0.0, 3.0], obstacles=[[1.0, 1.0, 0.8]],
    track=[[0.0, 0.0], [0.5, 1.5], [0.0, 2.5]],
)  # fmt: skip


@pytest.mark.parametrize(
    "name",
    ["k0.1-slope0-0.png", "conditionstorm-0.png", "conditionmy.storm-v2-11.png", "conditionstorm-k0.1-slope0-1.png"],
)
def test_pages_of_earlier_records_are_deleted_and_other_files_stay(tmp_path, name):
    for file in (name, "notes.png", f"my-{name}"):
        (tmp_path / file).touch()
    plot_maps(tmp_path, [DRIVE])
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(["k0.1-slope5-0.png", "notes.png", f"my-{name}"])
