"""Write the ground and the rocks of a place as a mesh, for other simulators and 3-D programs.

    python -m marssim.mesh --scene gale --seed 1 --out gale.glb
    python -m marssim.mesh --scene place.json --seed 1 --number 3 --out place.obj
    python -m marssim.mesh --scene gale --seed 1 --no-surroundings --out gale.stl

It is the place of scene --number of a dataset that marssim.generate made with the same --scene and --seed, and with the
relief and rocks of that place unchanged. In a dataset of --scene mixed, `preset` in sample.json names the place. The
mesh has four parts: `ground`, the finely gridded square; `surroundings` out to the horizon; `rocks`; and `outcrop`, the
slabs, ledges and fragments of bedrock. Parts without anything are left out. Rocks reach into the ground, and each is
closed.

Units are metres, with the origin on the ground in the middle. x is east, y north and z up; in a .glb file, y is up and
-z north, as glTF demands. Vertices have the colour of the soil and of each rock without dust, but not in .stl files.
The renderer computes gravel, small ripples, plates of bedrock that are flush with the sand, and the pattern of the
ground for each pixel; they are not in the mesh.

In Python, `scene_mesh` turns any Scene into a mesh, also that of a drive, `env.unwrapped.course.scene`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
import trimesh
import tyro

from marssim.base.command.limits import check_least
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.files.atomic import write_atomically
from marssim.render.surfaces.albedo import GROUND_COLOUR, ROCK_COLOUR, ROCK_SCALE
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS
from marssim.scene.rocks.mesh import Rocks
from marssim.scene.scene import Scene, build_scene

Suffix = Literal["glb", "obj", "ply", "stl"]
SUFFIXES: tuple[Suffix, ...] = get_args(Suffix)
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # turns z up into y up
GAMMA = 2.2  # of the colours that programs expect in all files but .glb, which holds linear ones


@dataclass(frozen=True)
class MeshOptions:
    """Write the ground and the rocks of a place as a mesh.

    Raises:
        ValueError: A value that cannot work; the message names the field.
    """

    out: Path
    """File to write: .glb (glTF), .obj, .ply or .stl. A file of that name is replaced."""
    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place that the scene is drawn from: a preset, or a JSON file of your own place."""
    seed: int = 0
    """Seed of the dataset, 0 or more."""
    number: int = 0
    """Number of the scene in the dataset, 0 or more."""
    surroundings: bool = True
    """Write the ground and the rocks out to the horizon too. Without them, the mesh ends with the finely gridded
    square; rocks whose middle lies outside of it are left out."""

    def __post_init__(self) -> None:
        check_least(self, seed=0, number=0)
        if self.out.suffix[1:].lower() not in SUFFIXES:
            raise ValueError(f"out must end in {', '.join(f'.{suffix}' for suffix in SUFFIXES)}, got {self.out}")
        if self.out.is_dir():
            raise ValueError(f"out must be a file, and {self.out} is a folder")


def scene_mesh(scene: Scene, surroundings: bool = True) -> dict[str, trimesh.Trimesh]:
    """Return the parts of a scene as meshes in the world frame [m]: x east, y north, z up.

    Args:
        scene: The scene.
        surroundings: Include what lies outside the finely gridded square.

    Returns:
        Of "ground", "surroundings", "rocks" and "outcrop" those that have faces. Colours of their vertices are linear
        albedo.
    """
    terrain = scene.terrain
    half = None if surroundings else scene.half
    soil = scene.look.soil_albedo
    parts = {
        "ground": _ground(*terrain.fine.mesh(), soil),
        "surroundings": _ground(*terrain.coarse.mesh(terrain.coarse_cells), soil) if surroundings else None,
        "rocks": _bodies(scene.rocks, half),
        "outcrop": _bodies(scene.outcrop.bodies, half),
    }
    return {name: part for name, part in parts.items() if part is not None}


class _KeepingNormals(trimesh.Trimesh):
    """A mesh whose copies, which trimesh's writers make, keep the normals of its vertices."""

    def copy(self, include_cache: bool = True, include_visual: bool = True) -> trimesh.Trimesh:
        return super().copy(include_cache, include_visual)


def encode_mesh(parts: dict[str, trimesh.Trimesh], suffix: Suffix) -> bytes:
    """Encode the parts of a scene, as of scene_mesh, as one file.

    Args:
        parts: The parts by name.
        suffix: Format of the file.

    Returns:
        The content of the file. In .ply and .stl, all parts are one mesh.
    """
    world, together = trimesh.Scene(), []
    for name, part in parts.items():
        visual: Any = part.visual
        colours = visual.vertex_colors[:, :3]
        written: Any = _KeepingNormals(
            part.vertices, part.faces, vertex_normals=part.vertex_normals, process=False,
            vertex_colors=colours if suffix == "glb" else screen_colours(colours),
        )  # fmt: skip
        if suffix == "glb":
            written.apply_transform(Y_UP)
        together.append(written)
        world.add_geometry(written, node_name=name, geom_name=name)
    if suffix in ("ply", "stl"):
        content = trimesh.util.concatenate(together).export(file_obj=None, file_type=suffix)
    else:
        content = world.export(file_obj=None, file_type=suffix, include_normals=True)
    return content.encode() if isinstance(content, str) else bytes(content)


def screen_colours(albedo: np.ndarray) -> np.ndarray:
    """Return linear albedo (N, 3), 0 to 255, as the colours (N, 3) uint8 that a screen shows."""
    return np.round(255 * (albedo / 255) ** (1 / GAMMA)).astype(np.uint8)


def _ground(vertices: np.ndarray, faces: np.ndarray, brightness: float) -> trimesh.Trimesh:
    used, inverse = np.unique(faces, return_inverse=True)
    colours = np.broadcast_to(brightness * np.array(GROUND_COLOUR), (len(used), 3))
    return _mesh(vertices[used], inverse.reshape(-1, 3), colours, None)


def _bodies(bodies: Rocks, half: float | None) -> trimesh.Trimesh | None:
    """Return bodies as one mesh, or None if there are none.

    Args:
        bodies: The bodies.
        half: Half the side of the square in which the middle of a body lies [m]; None takes all bodies.
    """
    inside = np.ones(len(bodies), bool) if half is None else (np.abs(bodies.centre[:, :2]) <= half).all(axis=1)
    faces = bodies.faces[inside[bodies.face_rock]]
    if not len(faces):
        return None
    owner = np.zeros(len(bodies.vertices), np.int64)
    owner[bodies.faces] = bodies.face_rock[:, None]
    used, inverse = np.unique(faces, return_inverse=True)
    colours = ROCK_SCALE * bodies.albedo[owner[used], None] * np.array(ROCK_COLOUR)
    return _mesh(bodies.vertices[used], inverse.reshape(-1, 3), colours, bodies.vertex_normals[used])


def _mesh(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, normals: np.ndarray | None) -> trimesh.Trimesh:
    colours = np.round(255 * np.clip(colours, 0, 1)).astype(np.uint8)
    return trimesh.Trimesh(vertices, faces, vertex_normals=normals, vertex_colors=colours, process=False)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(_work, MeshOptions, "python -m marssim.mesh", __doc__, args, STARTS_OVER)


def _work(options: MeshOptions) -> None:
    scene = build_scene(load_place(options.scene), np.random.default_rng((options.seed, options.number)))
    parts = scene_mesh(scene, options.surroundings)
    suffix: Suffix = next(name for name in SUFFIXES if name == options.out.suffix[1:].lower())
    write_atomically(options.out, encode_mesh(parts, suffix))
    faces = ", ".join(f"{name} {len(part.faces)}" for name, part in parts.items())
    total = counted(sum(len(part.faces) for part in parts.values()), "face")
    print(f"{options.out}: {total} ({faces})")


if __name__ == "__main__":
    sys.exit(main())
