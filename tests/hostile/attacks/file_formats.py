"""A small valid file of each format that is read, and the function that reads it."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch
from calibration_files import CALIBRATIONS, read_calibration_pair
from PIL import Image, TiffImagePlugin
from recorded_drives import drive_bytes
from small_network import SMALL

from envs.comparison.suite_results import read_results
from envs.drivers.policy_archive import read_policy
from envs.drives.episodes import EpisodeRecord
from envs.drives.records import read_record
from envs.suites.suite import FOLDER, load_suite
from m3depth.datasets.image_files import read_image
from m3depth.datasets.maps import read_map
from m3depth.evaluation.resume import SavedState
from m3depth.kinds.config import read_config
from m3depth.network.model import M3Depth
from m3depth.prediction.sources.bag_pairs import BagPairs
from m3depth.prediction.sources.poses import read_poses
from m3depth.training.config import TrainConfig
from m3depth.training.log import records
from m3depth.training.run import Run
from marssim.base.bags.library import typestore
from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.calibration.rectified import read_calibration
from marssim.base.calibration.rig_file import read_rig_file
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.drive_file import read_drive
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import read_sample, write_sample
from marssim.base.files.geotiff import encode_geotiff
from marssim.base.files.json_file import DatasetError
from marssim.base.files.pfm import decode_pfm, encode_pfm
from marssim.base.files.png import encode_png
from marssim.scene.heightmap import file_digest, read_heightmap
from marssim.scene.place_file import load_place
from nav.ground.read_map import read_map as read_elevation

Make = Callable[[Path], Path]  # writes the file, with what it needs, into a folder and returns its path
SIZE = (6, 8)
RECORD = EpisodeRecord(
    "straight", "ground_truth", "k=preset, slope=preset", 0, "goal", 3, 0.5, 4.0, 4.0, 4.1, 1.0, 2.0, 9.0, 0.1, 0.0, 0,
    [4.0, 0.0], track=[[0.0, 0.0], [4.0, 0.0]],
)  # fmt: skip


def _text(name: str, text: str) -> Make:
    def make(folder: Path) -> Path:
        (folder / name).write_text(text, encoding="utf-8")
        return folder / name

    return make


def _bytes(name: str, content: Callable[[], bytes]) -> Make:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(content())
        return folder / name

    return make


def _sample(name: str) -> Make:
    """Return a maker of a sample, which returns the path of one of its files."""

    def make(folder: Path) -> Path:
        depth = np.full(SIZE, 3.0, np.float32)
        image = np.full((*SIZE, 3), 90, np.uint8)
        normal = np.zeros((*SIZE, 3), np.float32) - np.array([0, 0, 1], np.float32)
        rig = NATECAM.resized(SIZE[1], SIZE[0])
        ground, none = np.zeros(SIZE, np.int32), np.zeros(SIZE, bool)
        disparity = rig.depth_to_disparity(depth)
        frame = StereoFrame(image, image, depth, disparity, normal, ground, none, rig, np.eye(4))
        write_sample(folder / "00", frame, {})
        return folder / "00" / name

    return make


def _bag(folder: Path) -> Path:
    pixels = np.full(SIZE, 7, np.uint8)
    rig = StereoRig(PinholeCamera.centred(8, 6, 10.0), 0.2)
    with StereoBagWriter(folder / "pair") as bag:
        bag.write_images(1, pixels, pixels, rig)
        bag.write_pose(1, np.eye(4), np.eye(4), rig.baseline)
    return folder / "pair" / "pair.mcap"


def _sqlite_bag(folder: Path) -> Path:
    """Write the same bag with SQLite's storage."""
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer

    with (
        Reader(_bag(folder).parent) as source,
        Writer(folder / "copy", version=9, storage_plugin=StoragePlugin.SQLITE3) as written,
    ):
        connections = {
            c.topic: written.add_connection(c.topic, c.msgtype, typestore=typestore()) for c in source.connections
        }
        for connection, stamp, raw in source.messages():
            written.write(connections[connection.topic], stamp, raw)
    return folder / "copy" / "copy.db3"


def _read_bag(path: Path) -> None:
    pairs = BagPairs(path)
    for number in range(pairs.count):
        left, _ = pairs.read(number)
        pairs.calibration(number)(left.shape[1], left.shape[0])
        pairs.pose(number)


def _map() -> bytes:
    return cv2.imencode(".tiff", np.full(SIZE, 3.0, np.float32))[1].tobytes()


def _read_bag_of(metadata: Path) -> None:
    """Read the bag of a metadata.yaml; a refusal names the bag, which is the folder."""
    try:
        _read_bag(metadata.parent)
    except DatasetError as error:
        assert str(error).startswith(str(metadata.parent)), error
        raise DatasetError(f"{metadata}: {error}") from None


def _weights(folder: Path) -> Path:
    M3Depth(SMALL).save_pretrained(folder / "weights.safetensors")
    return folder / "weights.safetensors"


def _policy(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "policy.zip", "w") as archive:
        with archive.open("policy.pth", "w") as file:
            torch.save({"action_net.weight": torch.ones(2, 3), "log_std": torch.zeros(2)}, file)
        archive.writestr("data", '{"num_timesteps": 1}')
    return folder / "policy.zip"


def _run(folder: Path) -> Run:
    config = TrainConfig((Path("data"),), folder, network=folder / "network.json", max_steps=9, device="cpu")
    return Run(config, torch.device("cpu"))


def _checkpoint(folder: Path) -> Path:
    (folder / "network.json").write_text(json.dumps(SMALL.to_dict()))
    run = _run(folder)
    sum(weight.square().sum() for weight in run.model.parameters()).backward()
    run.optimizer.step()
    run.save()
    return run.checkpoint


def _nav_map(name: str) -> Make:
    """Return a maker of a map of nav.map, which returns the path of one of its files."""

    def make(folder: Path) -> Path:
        for layer in ("top", "elevation", "weight"):
            heights = np.ones(SIZE, np.float32)
            (folder / f"{layer}.tif").write_bytes(encode_geotiff(heights, 0.0, 0.6, 0.1, float("nan")))
        place = {"cell_m": 0.1, "rows_columns": list(SIZE), "west_south_m": [0, 0], "origin_m": [0, 0]}
        (folder / "map.json").write_text(json.dumps(place))
        return folder / name

    return make


def _heightmap(suffix: str) -> Make:
    def make(folder: Path) -> Path:
        path, heights = folder / f"map{suffix}", np.arange(48.0, dtype=np.float32).reshape(SIZE)
        if suffix == ".npy":
            np.save(path, heights)
        elif suffix == ".png":
            path.write_bytes(encode_png(heights.astype(np.uint16)))
        else:
            tags = TiffImagePlugin.ImageFileDirectory_v2()
            tags[33550], tags.tagtype[33550] = (1.0, 1.0, 0.0), 12
            tags[34735], tags.tagtype[34735] = (1, 1, 0, 1, 1024, 0, 1, 1), 3
            tags[42113], tags.tagtype[42113] = "-9999", 2
            Image.fromarray(heights).save(path, tiffinfo=tags)
        return path

    return make


def _read_heightmap(path: Path) -> object:
    scale = None if path.suffix == ".tif" else 1.0
    return read_heightmap(str(path), file_digest(str(path)), scale, 0.1)


def _results() -> bytes:
    """Return the results of one drive of the packaged suite, as envs.evaluate writes them."""
    suite = load_suite("marsnav-v1")
    (split, condition, _), listed = next(item for item in suite.episodes.items() if item[0][2] == 0)
    episode = {
        "condition": condition, "course": 0, "driver": "straight", "perception": "ground_truth", "outcome": "stuck",
        "success": False, "spl": 0.0, "shortest": listed["shortest"], "path_length": 1.0, "distance": 19.5,
        "start_distance": float(np.hypot(*np.subtract(listed["goal"], listed["start"][:2]))), "steps": 5, "looks": 6,
        "abs_rel": None, "blind": 0, "rocks": None, "rocks_missed": None, "false_obstacles": None,
        "near_ground": None, "near_ground_as_sky": None,
        "min_clearance": 0.5, "step_seconds": 0.1, "perception_seconds": 0.0, "code": "0",
    }  # fmt: skip
    head = {"name": suite.name, "sha256": suite.sha256, "split": split, "conditions": [condition], "courses": 1}
    versions = {"mars-m3depth": "0", "python": "3", "machine": "x86_64"}
    content = {"suite": {**head, "shard": None}, "episodes": [episode], "code": {"0": 1}, "versions": versions}
    return json.dumps(content).encode()


def _unfinished(folder: Path) -> Path:
    state = SavedState(folder, {"--seed": 0})
    state.save({"sums": np.arange(5), "names": ["a", "b"]})
    return state.path


INDEX = {
    "schema": "marssim-stereo", "version": 3, "config": {"seed": 1},
    "samples": [{"name": f"0000{n}/00", "split": "train", "sha256": "0" * 64} for n in range(3)],
}  # fmt: skip
KITTI = "P0: 100 0 4 0 0 100 3 0 0 0 1 0\nP1: 100 0 4 -20 0 100 3 0 0 0 1 0\n"
POSES = "# KITTI, then TUM\n1 0 0 0.5 0 1 0 0 0 0 1 0\n0.5 1 2 3 0 0 0.6 0.8\n"
RIG = {
    "width": 320, "height": 240, "fx": 300.0, "fy": 301.0, "cx": 158.0, "cy": 121.0, "baseline": 0.2,
    "vergence_deg": 4.0, "distortion_model": "plumb_bob", "distortion_coefficients": [-0.22, 0.06, 0, 0],
    "rotation_deg": [0.5, 0.2, -0.7],
}  # fmt: skip
LOG = "".join(json.dumps({"kind": "train", "step": n, "loss": 2.5, "minutes": None}) + "\n" for n in range(3))
PLACE = json.dumps({"preset": "gale", "rocks": {"k": 0.1}})
FORMATS: dict[str, tuple[Make, Callable[[Path], object]]] = {
    "dataset.json": (_text("dataset.json", json.dumps(INDEX)), lambda path: StereoDataset(path.parent)),
    "sample.json": (_sample("sample.json"), lambda path: read_sample(path.parent)),
    "depth.png": (_sample("depth.png"), lambda path: read_sample(path.parent)),
    "place file": (_text("place.json", PLACE), load_place),
    "suite": (
        _bytes("suite.json", (FOLDER / "marsnav-v1.json").read_bytes),
        lambda path: load_suite(str(path)),
    ),
    "rig file": (_text("rig.json", json.dumps(RIG)), lambda path: read_rig_file([path])),
    "poses": (_text("poses.txt", POSES), partial(read_poses, axes="camera")),
    "network": (_text("network.json", json.dumps(SMALL.to_dict())), read_config),
    "map": (_bytes("depth.tiff", _map), lambda path: read_map(path, "depth")),
    "weights": (_weights, M3Depth.from_pretrained),
    "policy": (_policy, read_policy),
    "checkpoint": (_checkpoint, lambda path: _run(path.parent).resume()),
    "training log": (_text("log.jsonl", LOG), lambda path: records(path.parent, "train")),
    "unfinished evaluation": (_unfinished, lambda path: SavedState(path.parent, {"--seed": 0}).load()),
    "map of nav.map": (_nav_map("map.json"), lambda path: read_elevation(path.parent)),
    "layer of a map": (_nav_map("top.tif"), lambda path: read_elevation(path.parent)),
    "episode": (_text("episode.json", json.dumps(asdict(RECORD))), read_record),
    "results of a suite": (_bytes("results.json", _results), read_results),
    "recorded drive": (_bytes("drive.zip", drive_bytes), lambda path: read_drive(path).depth(0)),
    "heightmap .npy": (_heightmap(".npy"), _read_heightmap),
    "heightmap .png": (_heightmap(".png"), _read_heightmap),
    "heightmap .tif": (_heightmap(".tif"), _read_heightmap),
    "image": (_bytes("image.png", lambda: encode_png(np.full(SIZE, 7, np.uint8))), read_image),
    "PFM": (
        _bytes("image.pfm", lambda: encode_pfm(np.ones(SIZE, np.float32))),
        lambda path: decode_pfm(path.read_bytes()),
    ),
    "KITTI calibration": (_text("calib.txt", KITTI), read_calibration),
    **{name: (make, read_calibration_pair) for name, make in CALIBRATIONS.items()},
    "bag": (_bag, _read_bag),
    "bag .db3": (_sqlite_bag, _read_bag),
    "metadata of a bag": (lambda folder: _bag(folder).with_name("metadata.yaml"), _read_bag_of),
}
