"""Maps of true normals, in every kind of file, beside images that patterns find."""

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from m3depth.datasets.config import DataConfig
from m3depth.datasets.normal_maps import read_normals
from m3depth.datasets.open import open_pairs
from marssim.base.camera import PinholeCamera
from marssim.base.files.json_file import DatasetError

H, W = 24, 40
SHARED = {"left": "l/*.png", "right": "r/*.png", "depth": "d/*.npy", "focal": 50.0, "baseline": 0.27}


def towards_camera() -> np.ndarray:
    """Normals of unit length that turn left, up and to the camera by other amounts in each pixel."""
    v, u = np.mgrid[:H, :W] / W
    vectors = np.stack([-0.2 - u, -0.5 - v, -1.5 + u], -1)
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def put(path: Path, vectors: np.ndarray) -> None:
    """Write vectors as a file of the type that its name ends in; 8 bits in a .bmp, 16 in a .png."""
    if path.suffix == ".npy":
        np.save(path, vectors)
    elif path.suffix == ".exr":
        channels = {name: np.ascontiguousarray(vectors[..., i]) for i, name in enumerate("XYZ")}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(path))
    elif path.suffix == ".tiff":
        cv2.imwrite(str(path), vectors[..., ::-1])
    else:
        kind = np.uint8 if path.suffix == ".bmp" else np.uint16
        cv2.imwrite(str(path), np.round((vectors[..., ::-1] + 1) / 2 * np.iinfo(kind).max).astype(kind))


@pytest.mark.parametrize(
    ("normal", "others"),
    [
        ("View.Normal.XYZ", ["View.Position.XYZ", "View.Combined.RGB", "View.Depth.V"]),
        ("normals.RGB", ["position.XYZ"]),
        ("N.XYZ", ["RGB"]),
        ("XYZ", ["Position.XYZ"]),
    ],
)
def test_the_normals_of_an_exr_file_are_those_of_its_layer(tmp_path, normal, others) -> None:
    vectors = towards_camera()
    channels = {}
    for number, name in enumerate((normal, *others)):
        layer, dot, axes = name.rpartition(".")
        for i, axis in enumerate(axes):
            channels[f"{layer}{dot}{axis}"] = np.ascontiguousarray(vectors[..., i] + number)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(tmp_path / "n.exr"))
    np.testing.assert_allclose(read_normals(tmp_path / "n.exr", "opencv"), vectors, atol=1e-6)


@pytest.fixture
def folder(tmp_path) -> Path:
    """One pair with depth, without normals."""
    for name in "lrdn":
        (tmp_path / name).mkdir()
    for eye in "lr":
        cv2.imwrite(str(tmp_path / eye / "0.png"), np.random.default_rng(0).integers(0, 256, (H, W, 3), np.uint8))
    depth = np.full((H, W), 3.0, np.float32)
    depth[:, ::5] = np.nan  # so that no planes can be fitted, which these normals are not those of
    np.save(tmp_path / "d" / "0.npy", depth)
    return tmp_path


def read(folder: Path, ending: str, **changes) -> np.ndarray:
    return open_pairs(folder, "all", DataConfig(**SHARED, normal=f"n/*{ending}", **changes))[0].normal


@pytest.mark.parametrize(
    ("ending", "error"), [(".npy", 1e-6), (".exr", 1e-6), (".tiff", 1e-6), (".png", 1e-4), (".bmp", 0.01)]
)
@pytest.mark.parametrize("frame", ["opencv", "opengl"])
def test_normals_of_any_kind_of_file(folder, ending, error, frame) -> None:
    signs = np.array([1, -1, -1] if frame == "opengl" else [1, 1, 1], np.float32)
    put(folder / "n" / f"0{ending}", towards_camera() * signs)
    normal = read(folder, ending, normal_frame=frame)
    np.testing.assert_allclose(normal, towards_camera(), atol=error)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)


@pytest.mark.parametrize(("ending", "nothing"), [(".npy", np.nan), (".npy", 0.0), (".png", -1.0), (".bmp", 0.0)])
def test_pixels_without_a_normal_are_unknown(folder, ending, nothing) -> None:
    vectors = 0.98 * towards_camera()
    vectors[:5] = nothing
    put(folder / "n" / f"0{ending}", vectors)
    normal = read(folder, ending)
    assert not normal[:5].any() and normal[5:].any(-1).all()


def test_reduced_pairs_keep_their_normals(folder) -> None:
    put(folder / "n" / "0.npy", towards_camera())
    normal = read(folder, ".npy", resize=0.5)
    assert normal.shape == (H // 2, W // 2, 3)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
    assert np.abs(normal - towards_camera()[::2, ::2]).max() < 0.05


def ground(folder: Path) -> np.ndarray:
    """Put the depth of level ground that the cameras see from above into the folder, and return its normals."""
    camera = PinholeCamera.centred(W, H, 50.0)
    normal = np.array([0, -np.cos(np.deg2rad(50)), -np.sin(np.deg2rad(50))])
    np.save(folder / "d" / "0.npy", (-1.5 / (camera.rays() @ normal)).astype(np.float32))
    return np.broadcast_to(normal, (H, W, 3)).astype(np.float32)


OPENGL = np.array([1, -1, -1], np.float32)


@pytest.mark.parametrize("frame", ["opencv", "opengl"])
def test_normals_of_the_surface_are_taken_in_their_own_axes_alone(folder, frame) -> None:
    normals = ground(folder)
    put(folder / "n" / "0.npy", normals * (OPENGL if frame == "opengl" else 1))
    np.testing.assert_allclose(read(folder, ".npy", normal_frame=frame), normals, atol=1e-6)
    other = "opencv" if frame == "opengl" else "opengl"
    with pytest.raises(
        DatasetError, match=rf"in the axes of {other}, .* off planes .* try --normal-frame {frame}, which"
    ):
        read(folder, ".npy", normal_frame=other)


@pytest.mark.parametrize("frame", ["opencv", "opengl"])
def test_normals_in_axes_of_the_world_are_refused_in_either_frame(folder, frame) -> None:
    ground(folder)
    put(folder / "n" / "0.npy", np.broadcast_to(np.array([0, 0, 1], np.float32), (H, W, 3)))
    with pytest.raises(DatasetError, match=r"off planes that are fitted to the true depth; .* axes of the world"):
        read(folder, ".npy", normal_frame=frame)


def test_floats_that_are_coded_as_in_images_are_refused(folder) -> None:
    put(folder / "n" / "0.npy", (ground(folder) * OPENGL + 1) / 2)
    with pytest.raises(
        DatasetError, match=r"0\.npy: holds numbers of 0 to 1 that are no unit vectors: .* \(n \+ 1\) / 2"
    ):
        read(folder, ".npy", normal_frame="opengl")


def bad(folder: Path, vectors: np.ndarray) -> None:
    np.save(folder / "n" / "0.npy", vectors)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: bad(f, -towards_camera()), r"100 % of its normals turn away .* try --normal-frame opengl"),
        (lambda f: bad(f, towards_camera()[:20]), r"is 40 x 20, its image is 40 x 24"),
        (lambda f: bad(f, towards_camera()[..., :2]), r"holds no normals, three numbers a pixel"),
        (lambda f: (f / "n" / "0.npy").write_bytes(b""), r"holds no normals"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_file(folder, damage, message) -> None:
    damage(folder)
    with pytest.raises(DatasetError, match=rf"n/0\.npy: {message}") as error:
        read(folder, ".npy")
    assert "\n" not in str(error.value)


def test_a_pair_without_its_normals_is_named(folder) -> None:
    put(folder / "n" / "1.npy", towards_camera())
    with pytest.raises(DatasetError, match=r"l/0\.png: has no partner in .*n/\*\.npy"):
        read(folder, ".npy")
