from dataclasses import replace

import numpy as np
import pytest

import marssim.scene.scene as scenes
from marssim.engines.embree import TriangleRays
from marssim.scene.outcrop.config import OutcropConfig, draw_traits
from marssim.scene.outcrop.fragments import SIZES
from marssim.scene.outcrop.outcrop import KINDS, Outcrop
from marssim.scene.presets import preset
from marssim.scene.rocks.population import MAX_BODIES
from marssim.scene.scene import build_scene

FULL = OutcropConfig(slabs=(0.4, 0.4), ledges=(15.0, 15.0), fragments=(1.0, 1.0))
NONE = OutcropConfig(slabs=(0.0, 0.0), ledges=(0.0, 0.0), fragments=(0.0, 0.0))


def scene(outcrop, seed=2, clear=()):
    return build_scene(preset("jezero", size=10.0, horizon=24.0, outcrop=outcrop), seed, clear)


@pytest.fixture(scope="module")
def full():
    return scene(FULL)


@pytest.mark.parametrize(
    "bad", [{"slabs": (0.5, 0.2)}, {"slabs": (0.0, 0.9)}, {"slab_tilt_deg": (0.0, 20.0)}, {"ledge_height": (0.0, 0.2)}]
)
def test_impossible_outcrops_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        OutcropConfig(**bad)


def test_traits_are_drawn_from_their_ranges():
    for seed in range(20):
        traits = vars(draw_traits(preset("gale").outcrop, np.random.default_rng(seed)))
        for name, value in traits.items():
            low, high = getattr(preset("gale").outcrop, name)
            assert low <= value <= high


def test_ground_rocks_and_look_of_a_seed_do_not_depend_on_the_outcrop(full):
    bare = scene(NONE)
    assert len(bare.outcrop) == 0 and min(full.outcrop.count) > 20 and bare.bodies is bare.rocks
    assert np.array_equal(bare.terrain.fine.heights, full.terrain.fine.heights)
    for name in ("diameter", "height", "albedo", "faces", "face_rock"):
        assert np.array_equal(getattr(bare.rocks, name), getattr(full.rocks, name))
    assert np.array_equal(bare.rocks.centre[:, :2], full.rocks.centre[:, :2])
    raised = full.rocks.centre[:, 2] - bare.rocks.centre[:, 2]
    assert raised.min() == 0 and (raised > 0).sum() > 50 and raised.max() < 0.6
    assert np.array_equal(bare.look.sun, full.look.sun) and bare.abundance() == full.abundance()


def test_a_seed_gives_the_same_outcrop_again(full):
    first, second = full.outcrop, scene(FULL).outcrop
    assert first.count == second.count and np.array_equal(first.bodies.vertices, second.bodies.vertices)
    assert scene(FULL, seed=3).outcrop.count != first.count


def test_surface_ids_follow_those_of_the_rocks(full):
    ids = full.outcrop.surface_ids(len(full.rocks))
    assert list(ids) == ["rocks", *KINDS] and ids["rocks"] == [1, len(full.rocks)]
    assert [last - first + 1 for first, last in list(ids.values())[1:]] == list(full.outcrop.count)
    assert ids["fragments"][1] == len(full.bodies) <= MAX_BODIES
    assert (np.diff(full.bodies.face_rock) >= 0).all() and full.bodies.face_rock[-1] == len(full.bodies) - 1
    first = ids["fragments"][0] - 1
    assert full.bodies.diameter[first:].max() <= SIZES[1]
    assert Outcrop().surface_ids(3) == {"rocks": [1, 3], "slabs": [], "ledges": [], "fragments": []}


def test_bedrock_stays_out_of_clear_discs():
    disc = (1.0, -2.0, 2.5)
    bodies = scene(FULL, clear=(disc,)).outcrop
    bedrock = sum(bodies.count[:2])
    gap = np.hypot(*(bodies.bodies.centre[:bedrock, :2] - disc[:2]).T) - bodies.bodies.diameter[:bedrock] / 2
    assert gap.min() >= 2.5 - 1e-9


def test_chips_do_not_push_bedrock_out(full, monkeypatch):
    few = scene(replace(FULL, fragments=(0.0, 0.0))).outcrop
    assert full.outcrop.count[0] > few.count[0] + 50  # by chips
    monkeypatch.setattr(scenes, "MAX_PLATES", sum(few.count) + 20)
    capped = scene(FULL).outcrop
    assert few.count[0] < capped.count[0] <= few.count[0] + 20 and capped.count[1] == few.count[1]


@pytest.mark.parametrize("seed", [1, 2])
def test_no_bed_floats_beside_clear_discs(seed):
    full = scene(FULL, seed, ((1.0, -2.0, 2.5), (-3.0, 3.0, 1.0), (4.0, 3.0, 0.5)))
    bodies, slabs = full.outcrop.bodies, full.outcrop.count[0]
    start = np.array([bodies.faces[bodies.face_rock == n].min() for n in range(len(bodies))])
    beds, down = 0, np.array([[0, 0, -1]], dtype=np.float32)
    rays = TriangleRays(bodies.vertices, bodies.faces)
    for corners in np.split(bodies.vertices, start[1:])[:slabs]:
        if (corners[:, 2] < full.terrain.height_at(*corners[:, :2].T)).any():
            continue  # its sides reach into the ground
        beds += 1
        below = np.array([[*corners[:, :2].mean(axis=0), corners[:, 2].min() - 0.001]], dtype=np.float32)
        assert rays.meet(below, down)[0][0] >= 0  # a slab or a bed
    assert beds > 20


def test_presets_have_bedrock_after_their_places():
    share = {name: np.mean(preset(name).outcrop.slabs) for name in ("utopia", "jezero", "gale")}
    assert share["utopia"] < 0.05 < 0.3 < min(share["jezero"], share["gale"])
    assert preset("utopia").outcrop.ledges == (0.0, 0.0) and preset("gale").outcrop.ledges[1] > 0
    assert replace(preset("hard"), outcrop=NONE).outcrop == NONE
