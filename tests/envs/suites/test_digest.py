import os
import platform
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from envs.suites.digest import scene_digests
from envs.suites.suite import build_course, load_suite

ROOT = Path(__file__).parents[3]

# Without the instructions that libraries choose by the processor. Names that a processor lacks have no effect.
NO_AVX512 = {"NPY_DISABLE_CPU_FEATURES": "X86_V4,AVX512_ICL,AVX512_SPR,AVX512F,AVX512_SKX"}
NO_AVX2 = {
    "NPY_DISABLE_CPU_FEATURES": NO_AVX512["NPY_DISABLE_CPU_FEATURES"] + ",X86_V3,AVX2,FMA3",
    "OPENCV_CPU_DISABLE": "AVX2,FMA3",
}  # fmt: skip
EPISODES = (("clear", 0), ("ledges", 3))  # of the split dev of marsnav-v1
SAVE = """
import sys
from tests.envs.suites.test_digest import save_scenes
save_scenes(sys.argv[1])
"""
SAME = 1e-11  # [m] by which scenes of two processors may differ


@pytest.fixture(scope="module")
def scene(make_scene):
    return make_scene(lambda x, y: 0.0113 * x, rocks=[(1.0, 2.0, 0.6, 0.3), (3.0, 0.0, 0.06, 0.03)])


def lifted(scene, by):
    fine = scene.terrain.fine
    return replace(scene, terrain=replace(scene.terrain, fine=replace(fine, heights=fine.heights + by)))


def with_vertices(scene, change):
    vertices = scene.rocks.vertices.copy()
    change(vertices)
    return replace(scene, rocks=replace(scene.rocks, vertices=vertices))


def test_one_changed_height_or_vertex_changes_both_digests(scene):
    first = scene_digests(scene)
    assert first == scene_digests(scene) and first[0] != first[1]
    bump = np.zeros_like(scene.terrain.fine.heights)
    bump[39, 41] = 0.002
    coarse = scene.terrain.coarse
    far = replace(scene, terrain=replace(scene.terrain, coarse=replace(coarse, heights=coarse.heights + 0.002)))
    for other in (lifted(scene, bump), far, with_vertices(scene, lambda v: np.add.at(v, (-1, 2), 0.002))):
        assert not set(scene_digests(other)) & set(first)


def changed_by(make_scene, heights, noise):
    """Whether noise [m] on the heights changes both digests of a scene of these heights every metre."""
    scene = make_scene(lambda x, y: heights if x.shape == heights.shape else 0 * x, cell=1.0, half=len(heights) // 2)
    drawn = np.random.default_rng(1).uniform(-noise, noise, heights.shape)
    return not any(a == b for a, b in zip(scene_digests(scene), scene_digests(lifted(scene, drawn))))


@pytest.mark.parametrize("level", [0.0, 0.0005, 0.0012])
def test_numbers_at_the_steps_of_one_digest_do_not_matter(make_scene, level):
    """Heights of 0 and 0.5 mm lie on a step of one of the digests, but not of the other."""
    assert not changed_by(make_scene, np.full((21, 21), level), 1e-7)


@pytest.mark.parametrize(("level", "differing"), [(0.0003, 1), (0.0008, 0)])
def test_the_steps_of_the_digests_lie_half_a_millimetre_apart(make_scene, level, differing):
    scene = make_scene(lambda x, y: np.full_like(x, level), cell=1.0, half=10)
    same = [a == b for a, b in zip(scene_digests(scene), scene_digests(lifted(scene, 0.0004)))]
    assert same == [number != differing for number in (0, 1)]


def test_the_last_bits_of_all_heights_do_not_matter_and_micrometres_do(make_scene):
    heights = np.random.default_rng(0).uniform(-1, 1, (301, 301))
    assert not changed_by(make_scene, heights, 1e-13) and changed_by(make_scene, heights, 1e-6)


@cache
def scenes():
    """The scenes of EPISODES by condition."""
    suite = load_suite("marsnav-v1")
    seeds = {condition: suite.episodes["dev", condition, number]["seed"] for condition, number in EPISODES}
    return {name: build_course(suite.conditions[name], seed).scene for name, seed in seeds.items()}


def numbers(scene):
    return np.concatenate([
        scene.terrain.fine.heights.ravel(), scene.terrain.coarse.heights.ravel(), scene.bodies.vertices.ravel()
    ])  # fmt: skip


def save_scenes(file):
    np.savez(file, **{name: numbers(scene) for name, scene in scenes().items()})


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="the instructions are those of x86-64")
@pytest.mark.parametrize("environment", [NO_AVX512, NO_AVX2], ids=["no AVX-512", "no AVX2"])
def test_a_processor_without_newer_instructions_builds_the_same_scenes(environment, tmp_path):
    command = [sys.executable, "-W", "ignore", "-c", SAVE, str(tmp_path / "there.npz")]
    subprocess.run(command, env={**os.environ, **environment}, cwd=ROOT, check=True)
    there = np.load(tmp_path / "there.npz")
    for name, scene in scenes().items():
        here = numbers(scene)
        assert here.shape == there[name].shape and np.abs(here - there[name]).max() < SAME


def test_the_light_does_not_matter(scene):
    assert scene_digests(scene.with_sun(10, 0)) == scene_digests(scene)
