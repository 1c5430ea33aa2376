"""A scene's mesh is read back by trimesh, and rays meet it where the renderer sees the scene."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from marssim import SceneConfig, SceneRenderer, build_scene, preset, save_place
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.engines.embree import TriangleRays
from marssim.generation.config import GenerateConfig
from marssim.generation.scene_views import draw_scene
from marssim.mesh import SUFFIXES, encode_mesh, main, scene_mesh
from marssim.render.surfaces.albedo import GROUND_COLOUR, ROCK_COLOUR, ROCK_SCALE

RIG = StereoRig(PinholeCamera.centred(96, 96, 110.0), 0.27)


def place(name: str = "gale") -> SceneConfig:
    """Return a small place with some of everything."""
    whole = preset(name)
    return SceneConfig(**{**{n: getattr(whole, n) for n in ("preset", "relief", "rocks", "outcrop", "look")},
                          "size": 12.0, "cell": 0.1, "horizon": 16.0})  # fmt: skip


@pytest.fixture(scope="module")
def scene():
    return build_scene(place(), 3)


@pytest.fixture(scope="module")
def frame(scene):
    with SceneRenderer(scene, rig=RIG) as renderer:
        return renderer.render(x=0.0, y=-1.0, yaw_deg=40.0)


def read(content: bytes, suffix: str) -> trimesh.Trimesh:
    """The content of a file as one mesh with z up."""
    mesh = trimesh.load(trimesh.util.wrap_as_stream(content), file_type=suffix, process=False)
    mesh = mesh.to_geometry() if isinstance(mesh, trimesh.Scene) else mesh
    if suffix == "glb":
        x, y, z = mesh.vertices.T
        mesh.vertices = np.stack([x, -z, y], axis=1)
    return mesh


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_rays_meet_the_mesh_where_the_renderer_sees_the_scene(scene, frame, suffix):
    mesh = read(encode_mesh(scene_mesh(scene), suffix), suffix)
    rays = (RIG.camera.rays() @ frame.pose[:3, :3].T).reshape(-1, 3)
    face, distance = TriangleRays(mesh.vertices, mesh.faces).meet(frame.pose[None, :3, 3], rays)
    met, seen = (face >= 0).reshape(96, 96), np.isfinite(frame.depth)
    assert (met == seen).mean() > 0.995
    both = met & seen
    apart = np.abs(distance.reshape(96, 96)[both] - frame.depth[both]) / frame.depth[both]
    assert both.sum() > 5000 and np.median(apart) < 0.005  # of the gravel and ripples that the mesh lacks
    rock = (frame.surface > 0)[both]
    assert rock.sum() > 100 and np.median(apart[rock]) < 0.005


def test_the_parts_keep_their_names_and_colours(scene):
    parts = scene_mesh(scene)
    assert list(parts) == ["ground", "surroundings", "rocks", "outcrop"]
    content = encode_mesh(parts, "glb")
    read_back = trimesh.load(trimesh.util.wrap_as_stream(content), file_type="glb", process=False)
    assert sorted(read_back.geometry) == sorted(parts)
    for name, part in parts.items():
        assert len(read_back.geometry[name].faces) == len(part.faces)
    colour = np.asarray(read_back.geometry["ground"].visual.vertex_colors)[0, :3]
    assert colour == pytest.approx(255 * scene.look.soil_albedo * np.array(GROUND_COLOUR), abs=1)
    # other files hold colours for the screen, which are brighter
    brighter = np.asarray(read(encode_mesh(parts, "ply"), "ply").visual.vertex_colors)[0, :3]
    assert (brighter > colour).all()
    groups = [line for line in encode_mesh(parts, "obj").decode().splitlines() if line.startswith("o ")]
    assert sorted(groups) == sorted(f"o {name}" for name in parts)


def test_rocks_are_closed_and_face_outwards(scene):
    rocks = scene_mesh(scene)["rocks"]
    assert len(rocks.faces) == len(scene.rocks.faces)
    assert rocks.is_watertight and rocks.is_winding_consistent and rocks.volume > 0
    body = trimesh.graph.connected_component_labels(rocks.face_adjacency)
    assert body.max() + 1 == len(scene.rocks)
    a, b, c = rocks.triangles.transpose(1, 0, 2)
    volumes = np.bincount(body, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)
    assert volumes.min() > 0 and volumes.sum() == pytest.approx(rocks.volume)


def test_without_surroundings_the_mesh_ends_with_the_fine_square(scene):
    parts = scene_mesh(scene, surroundings=False)
    assert "surroundings" not in parts
    assert np.abs(parts["ground"].bounds[:, :2]).max() == pytest.approx(scene.half)
    inside = (np.abs(scene.rocks.centre[:, :2]) <= scene.half).all(axis=1)
    bodies = trimesh.graph.connected_component_labels(parts["rocks"].face_adjacency).max() + 1
    assert 0 < inside.sum() < len(inside) and bodies == inside.sum()
    # what is kept is as it was
    kept = scene.rocks.vertices[np.unique(scene.rocks.faces[inside[scene.rocks.face_rock]])]
    np.testing.assert_array_equal(parts["rocks"].vertices, kept)


def test_each_rock_has_its_own_brightness(scene):
    rocks = replace(scene.rocks, albedo=np.where(np.arange(len(scene.rocks)) % 2, 0.3, 0.9))
    kept = (np.abs(rocks.centre[:, :2]) <= scene.half).all(axis=1)[rocks.face_rock]
    part = scene_mesh(replace(scene, rocks=rocks), surroundings=False)["rocks"]
    np.testing.assert_array_equal(part.triangles, rocks.vertices[rocks.faces[kept]])
    brightness = np.repeat(rocks.albedo[rocks.face_rock[kept], None], 3, axis=1)  # of the corners of each face
    colours = part.visual.vertex_colors[part.faces, :3]
    bare = 255 * ROCK_SCALE * brightness[..., None] * np.array(ROCK_COLOUR)
    np.testing.assert_allclose(colours, bare, atol=0.5)


def test_a_place_without_rocks_has_none(scene):
    bare = place("utopia")
    bare = replace(bare, rocks=replace(bare.rocks, k=0.0), outcrop=replace(bare.outcrop, slabs=(0, 0), ledges=(0, 0)))
    assert "rocks" not in scene_mesh(build_scene(bare, 0))


def test_the_command_writes_the_place_of_a_dataset(tmp_path, capsys):
    save_place(place(), tmp_path / "place.json")
    out = tmp_path / "mine.GLB"
    arguments = ["--scene", str(tmp_path / "place.json"), "--seed", "5", "--number", "2", "--out", str(out)]
    assert main(arguments) == 0
    dataset = GenerateConfig(out=tmp_path / "data", seed=5, pairs=6, views_per_scene=2, scenes=(place(),))
    same = draw_scene(dataset, 2)
    assert out.read_bytes() == encode_mesh(scene_mesh(same), "glb")
    total = sum(len(part.faces) for part in scene_mesh(same).values())
    assert capsys.readouterr().out.startswith(f"{out}: {total} faces (ground ")
    assert main([*arguments, "--no-surroundings"]) == 0
    assert out.read_bytes() == encode_mesh(scene_mesh(same, surroundings=False), "glb")


def test_mistakes_are_one_line(tmp_path, capsys):
    (tmp_path / "folder.obj").mkdir()
    for arguments, message in (
        (["--out", str(tmp_path / "place.usd")], "--out must end in .glb, .obj, .ply, .stl, got "),
        (["--out", str(tmp_path / "folder.obj")], "--out must be a file, and "),
        (["--out", str(tmp_path / "a.glb"), "--seed", "-1"], "--seed must be"),
        (["--out", str(tmp_path / "a.glb"), "--number", "-1"], "--number must be"),
        (["--out", str(tmp_path / "a.glb"), "--scene", "nowhere"], ""),
        (["--out", str(tmp_path / "none" / "a.glb"), "--scene", str(tmp_path / "no.json")], str(tmp_path / "no.json")),
    ):
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ") and message in error and error.count("\n") == 1
    assert not list(tmp_path.glob("*.glb"))


def projected_area(part: trimesh.Trimesh) -> float:
    """Return the area on the map [m2], negative for faces that look down."""
    a, b, c = np.moveaxis(part.triangles[..., :2], 1, 0)
    (x, y), (u, v) = (b - a).T, (c - a).T
    return float((x * v - y * u).sum() / 2)


def test_the_ground_looks_up_and_no_part_of_it_lies_below_another(scene):
    parts = scene_mesh(scene)
    for name in ("ground", "surroundings"):
        assert (parts[name].face_normals[:, 2] > 0).all()
    outer = np.ptp(parts["surroundings"].bounds[:, 0]) ** 2
    inner = projected_area(parts["ground"])
    assert inner == pytest.approx((2 * scene.half) ** 2, rel=1e-9)
    assert 0.95 * outer < inner + projected_area(parts["surroundings"]) <= outer * (1 + 1e-9)


def normals_in(content: bytes, suffix: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and the normals in a file, world frame."""
    back = trimesh.load(trimesh.util.wrap_as_stream(content), file_type=suffix, process=False)
    mesh = next(iter(back.geometry.values())) if isinstance(back, trimesh.Scene) else back  # of the single part
    if suffix != "glb":
        return mesh.vertices, mesh.vertex_normals
    places, normals = (np.stack([x, -z, y], axis=1) for x, y, z in (mesh.vertices.T, mesh.vertex_normals.T))
    return places, normals


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_files_hold_normals_that_face_outwards(scene, suffix):
    content = encode_mesh({"rocks": scene_mesh(scene, surroundings=False)["rocks"]}, suffix)
    assert (b'"NORMAL"' if suffix == "glb" else b"\nvn ") in content
    places, normals = normals_in(content, suffix)
    apart, at = cKDTree(scene.rocks.vertices).query(places)
    assert apart.max() < 1e-5
    assert (np.einsum("ij,ij->i", normals, scene.rocks.vertex_normals[at]) > 0).all()


def test_the_parts_have_the_normals_of_the_scene(scene):
    part = scene_mesh(scene, surroundings=False)["rocks"]
    apart, at = cKDTree(scene.rocks.vertices).query(part.vertices)
    assert apart.max() == 0
    np.testing.assert_allclose(part.vertex_normals, scene.rocks.vertex_normals[at], atol=1e-12)


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply"])
def test_files_hold_the_normals_of_the_scene(scene, suffix):
    places, normals = normals_in(encode_mesh({"rocks": scene_mesh(scene, surroundings=False)["rocks"]}, suffix), suffix)
    at = cKDTree(scene.rocks.vertices).query(places)[1]
    np.testing.assert_allclose(normals, scene.rocks.vertex_normals[at], atol=1e-5)


@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_colours_for_the_screen_are_those_of_the_albedo_with_gamma(scene, suffix):
    mesh = read(encode_mesh({"ground": scene_mesh(scene)["ground"]}, suffix), suffix)
    colour = np.asarray(mesh.visual.vertex_colors)[:, :3].astype(float)
    soil = scene.look.soil_albedo * np.array(GROUND_COLOUR)
    assert np.abs(colour - 255 * soil ** (1 / 2.2)).max() <= 2


def test_bodies_outside_of_the_fine_square_are_left_out_by_either_coordinate(scene):
    """Rocks and outcrop are the same bodies here, 3 m to the north, so that some lie outside by y alone."""
    outside = scene.rocks.centre + np.array([0.0, 3.0, 0.0])
    rocks = replace(scene.rocks, centre=outside)
    outcrop = replace(scene.outcrop, bodies=rocks)
    inside = (np.abs(outside[:, :2]) <= scene.half).all(axis=1)
    assert 0 < inside.sum() < (np.abs(outside[:, 0]) <= scene.half).sum()
    parts = scene_mesh(replace(scene, rocks=rocks, outcrop=outcrop), surroundings=False)
    for name in ("rocks", "outcrop"):
        assert len(parts[name].faces) == inside[rocks.face_rock].sum()
