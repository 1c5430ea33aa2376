from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.dataset.frame import GROUND
from marssim.render.surfaces.shading import DUST_SCALE_HEIGHT, Shader
from marssim.scene.look import LOOK_LIMITS, LookConfig, draw_look
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

FOCAL = 600.0
SMALL = SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.1))
SCENE = build_scene(SMALL, np.random.default_rng(2))
EYE = np.array([0.0, 0.0, 1.2])


def towards(elevation_deg: float, azimuth_deg: float) -> np.ndarray:
    elevation, azimuth = np.deg2rad([elevation_deg, azimuth_deg])
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def shader(scene: Scene = SCENE, **look) -> Shader:
    return Shader(replace(scene, look=replace(scene.look, **look)))


def around(count: int = 500, near: float = 1.0, far: float = 6.0) -> np.ndarray:
    """Return points on level ground around the eye."""
    rng = np.random.default_rng(0)
    reach, angle = rng.uniform(near, far, count), rng.uniform(0, 2 * np.pi, count)
    return np.stack([reach * np.cos(angle), reach * np.sin(angle), np.zeros(count)], axis=1)


def level(renderer: Shader, points: np.ndarray, lit: float = 1.0, eye: np.ndarray = EYE) -> np.ndarray:
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return renderer.surface(points, up, np.full(len(points), GROUND), eye, np.full(len(points), lit), FOCAL)


@given(elevation=st.floats(10, 89), depth=st.floats(0.1, 2.0))
def test_what_the_sun_reaches_is_brighter(elevation, depth):
    renderer = shader(sun=towards(elevation, 40), optical_depth=depth)
    points = around()
    dark, half, lit = (level(renderer, points, share) for share in (0.0, 0.5, 1.0))
    sunlit = (lit > dark).all(axis=1)  # a steep slope of the fine relief may turn away from a low sun
    assert sunlit.mean() > 0.6 and (lit >= dark).all()
    assert np.allclose(half, (lit + dark) / 2, atol=1e-5)
    assert (dark > 0).all()  # shadows are filled by the sky


@given(
    elevation=st.floats(1, 90),
    depth=st.floats(0, 3),
    contrast=st.floats(0, 2),
    strength=st.floats(0, 2),
    seed=st.integers(0, 2**32 - 1),
)
def test_radiance_is_finite_and_sane(elevation, depth, contrast, strength, seed):
    rng = np.random.default_rng(seed)
    renderer = shader(
        sun=towards(elevation, 200), optical_depth=depth, albedo_contrast=contrast, texture_strength=strength
    )
    points = rng.normal(0, 5, (300, 3))
    normals = rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign(np.einsum("ij,ij->i", normals, EYE - points))[:, None]
    surface = rng.integers(0, len(SCENE.rocks) + 1, 300)
    radiance = renderer.surface(points, normals, surface, EYE, rng.uniform(0, 1, 300), FOCAL)
    assert radiance.shape == (300, 3) and radiance.dtype == np.float32
    assert np.isfinite(radiance).all() and (radiance >= 0).all()
    assert radiance.max() < 3  # of a white surface under the sun at zenith


@pytest.mark.parametrize("name", LOOK_LIMITS)
@pytest.mark.parametrize("end", [0, 1])
def test_radiance_is_finite_at_the_ends_of_every_range(name, end):
    value = LOOK_LIMITS[name][end] or (0.01 if name == "sun_elevation_deg" else 0.0)
    renderer = Shader(replace(SCENE, look=draw_look(LookConfig(**{name: (value, value)}), np.random.default_rng(1))))
    sky = renderer.sky(np.eye(3, dtype=np.float32))
    for radiance in (level(renderer, around()), sky):
        assert np.isfinite(radiance).all() and (radiance >= 0).all() and radiance.max() > 0


def test_the_sky_is_brighter_near_the_sun_and_at_the_horizon():
    renderer = shader(sun=towards(30, 50))
    at = np.stack([towards(30, azimuth) for azimuth in (50, 60, 90, 150, 230)])
    assert (np.diff(renderer.sky(at).mean(axis=1)) < 0).all()
    up = np.stack([towards(elevation, 230) for elevation in (2, 15, 40)])
    assert (np.diff(renderer.sky(up).mean(axis=1)) < 0).all()
    colour = renderer.sky(np.stack([towards(e, a) for e in (1, 30, 80) for a in range(0, 360, 30)]))
    assert (colour[:, 0] > colour[:, 1]).all() and (colour[:, 1] > colour[:, 2]).all()  # butterscotch


def test_the_sky_is_darker_under_a_low_sun():
    up = np.array([[0.0, 0.0, 1.0]])
    high, low = (shader(sun=towards(e, 0), optical_depth=0.5).sky(up).mean() for e in (40, 10))
    assert 0.4 * high < low < 0.8 * high


def test_the_ground_scatters_back_to_where_the_light_comes_from():
    renderer = shader(sun=towards(25, 0), texture_strength=0.0, albedo_contrast=0.0)
    up = np.array([[2.0, 0.0, 0.0], [-2.0, 0.0, 0.0]])  # looking towards the sun, and with the sun behind
    against, along = level(renderer, up)
    assert (along > 1.1 * against).all()


def test_light_follows_the_slope():
    renderer = shader(sun=towards(30, 0), texture_strength=0.0, albedo_contrast=0.0)
    tilt = np.deg2rad([-20, 0, 20])
    normals = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], axis=1)
    points = np.tile([0.0, 2.0, 0.0], (3, 1))
    radiance = renderer.surface(points, normals, np.zeros(3, int), EYE, np.ones(3), FOCAL)
    assert (np.diff(radiance, axis=0) > 0).all()


def test_a_low_sun_is_redder_and_weaker():
    high, low = (
        level(shader(sun=towards(e, 0), texture_strength=0.0, albedo_contrast=0.0, optical_depth=0.8), around()).mean(0)
        - level(
            shader(sun=towards(e, 0), texture_strength=0.0, albedo_contrast=0.0, optical_depth=0.8), around(), 0.0
        ).mean(0)
        for e in (60, 12)
    )
    assert (low < high).all()
    assert low[0] / low[2] > 1.1 * high[0] / high[2]


def test_rocks_have_their_own_albedo():
    dark, bright = np.argsort(SCENE.rocks.albedo)[[0, -1]]
    renderer = shader(sun=towards(40, 180), albedo_contrast=0.0, texture_strength=0.0, rock_dust=0.0)
    faces = np.array([[-1.0, 0.0, 0.0]] * 2)  # too steep for dust to lie on
    points = np.array([[2.0, 0.0, 0.3]] * 2)
    colour = renderer.surface(points, faces, np.array([dark + 1, bright + 1]), EYE, np.ones(2), FOCAL)
    expected = SCENE.rocks.albedo[bright] / SCENE.rocks.albedo[dark]
    assert np.allclose(colour[1] / colour[0], expected, rtol=0.02)
    ground = renderer.surface(points[:1], faces[:1], np.array([GROUND]), EYE, np.ones(1), FOCAL)[0]
    assert ground[0] / ground[2] > 1.2 * colour[0, 0] / colour[0, 2]  # the ground is redder than bare rock


def test_sand_lies_against_the_foot_of_a_rock_and_not_higher():
    renderer = shader(sun=towards(40, 180), albedo_contrast=0.0, texture_strength=0.0, rock_dust=0.0)
    rock = int(np.argmax(SCENE.rocks.height))
    x, y, _ = SCENE.rocks.centre[rock]
    ground = float(SCENE.terrain.height_at(x, y))
    heights = np.array([0.0, 0.5, 1.0]) * SCENE.rocks.height[rock]
    points = np.stack([np.full(3, x), np.full(3, y), ground + heights], axis=1)
    faces = np.tile([-1.0, 0.0, 0.0], (3, 1))
    colour = renderer.surface(points, faces, np.full(3, rock + 1), EYE, np.ones(3), FOCAL)
    red = colour[:, 0] / colour[:, 2]
    assert red[0] > 1.2 * red[1] and red[1] == pytest.approx(red[2], rel=1e-3)


def test_wind_ripples_and_pebbles_come_and_go_with_their_knobs():
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (4000, 3)) * [1, 1, 0] + [2, 0, 0]
    none, pebbles, ripples = (
        (lambda colour: colour.std() / colour.mean())(
            level(shader(sun=towards(30, 0), pebbles=p, wind_ripples=r, texture_strength=1.0, bedrock=0.0), points)[
                :, 0
            ]
        )
        for p, r in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    )
    assert pebbles > 1.1 * none and ripples > 1.1 * none


def test_dust_clings_to_the_sides_of_some_rocks_as_much_as_its_knob_says():
    count = len(SCENE.rocks)
    faces, points = np.tile([-1.0, 0.0, 0.0], (count, 1)), np.tile([2.0, 0.0, 3.0], (count, 1))
    reds = []
    for dust in (0.0, 0.4, 0.9):
        renderer = shader(sun=towards(40, 180), albedo_contrast=0.0, texture_strength=0.0, rock_dust=dust)
        colour = renderer.surface(points, faces, np.arange(count) + 1, EYE, np.ones(count), FOCAL)
        reds.append(colour[:, 0] / colour[:, 2])
    assert np.ptp(reds[0]) < 0.1 and (reds[0].mean() < reds[1].mean() < reds[2].mean()) and np.ptp(reds[2]) > 0.3


@pytest.mark.parametrize("contrast", [1.0, 3.0])
def test_nothing_gives_back_more_light_than_it_gets(contrast):
    """The albedo: of ground and of rocks as bright as the config allows, in shadow under an even sky."""
    rocks = replace(SCENE.rocks, albedo=np.full(len(SCENE.rocks), 2.7))
    renderer = shader(
        replace(SCENE, rocks=rocks), sun=towards(89.9, 0), albedo_contrast=contrast, bedrock=0.5, optical_depth=1e-4
    )
    points = np.random.default_rng(0).uniform(-3.9, 3.9, (5000, 3)) * [1, 1, 0] + [0, 0, 1]
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    for surface in (np.full(len(points), GROUND), np.arange(len(points)) % len(rocks) + 1):
        dark = renderer.surface(points, up, surface, EYE + np.array([0, 0, 3.0]), np.zeros(len(points)), FOCAL)
        assert dark.max() <= 0.92 * (renderer.light.skylight + 0.18 / 0.27 * 0.45 * renderer.light.sunlight.max())


def test_rocks_differ_in_colour_as_the_contrast_says():
    faces, points = np.tile([-1.0, 0.0, 0.0], (50, 1)), np.tile([2.0, 0.0, 3.0], (50, 1))
    spread = []
    for contrast in (0.0, 0.5, 1.0):
        renderer = shader(sun=towards(40, 180), albedo_contrast=contrast, texture_strength=0.0, rock_dust=0.0)
        colour = renderer.surface(points, faces, np.arange(50) + 1, EYE, np.ones(50), FOCAL)
        spread.append((colour[:, 0] / colour[:, 2]).std())
    assert spread[0] < 0.5 * spread[1] < 0.4 * spread[2]


def test_bedrock_is_paler_than_sand_and_shows_as_its_knob_says():
    points = np.random.default_rng(1).uniform(-10, 10, (20_000, 3)) * [1, 1, 0]
    looks = [
        level(shader(sun=towards(50, 0), wind_ripples=0.0, pebbles=0.0, albedo_contrast=1.0, bedrock=share), points)
        for share in (0.0, 0.2, 0.5, 1.0)
    ]
    assert (np.abs(looks[0] - looks[1]).max(axis=1) > 1e-6).mean() < 0.3
    bare = [(look[:, 2] / look[:, 0]).mean() for look in looks]  # sand is redder
    assert (np.diff(bare) > 0).all()


def test_relief_shows_in_the_shadow_under_a_low_sun():
    """The sky is brighter on the sun's side, so that slopes towards it are brighter without sunlight, too."""
    tilt = np.deg2rad([-20, 20])
    normals = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], axis=1)
    points = np.tile([0.0, 2.0, 0.0], (2, 1))

    def ratio(elevation: float) -> float:
        renderer = shader(sun=towards(elevation, 0), texture_strength=0.0, albedo_contrast=0.0)
        away, facing = renderer.surface(points, normals, np.zeros(2, int), EYE, np.zeros(2), FOCAL)[:, 0]
        return facing / away

    assert ratio(15) > 1.3 and ratio(89) == pytest.approx(1, abs=0.02)


def test_stones_stand_for_the_rocks_that_the_mesh_leaves_out_far_away():
    share = np.random.default_rng(0).uniform(-1, 1, (3000, 3)) * [1, 1, 0]
    near, far = share * SCENE.half, 0.2 * share * SCENE.half + [2.4 * SCENE.half, 0, 0]
    few = replace(SCENE, config=replace(SMALL, rocks=RockConfig(k=0.0)))
    change = [np.abs(level(shader(SCENE), at) - level(shader(few), at)).max() for at in (near, far)]
    assert change[0] == 0 and change[1] > 0.01


def test_rocks_take_sky_from_the_ground_beside_them():
    renderer = shader(sun=towards(40, 180), albedo_contrast=0.0, texture_strength=0.0)
    inside = (np.abs(SCENE.rocks.centre[:, :2]) < SCENE.half - 1.5).all(axis=1)
    rock = int(np.argmax(SCENE.rocks.height * inside))
    centre, radius = SCENE.rocks.centre[rock], SCENE.rocks.diameter[rock] / 2
    points = np.stack([centre[0] - radius - np.array([0.05, 1.0]), np.full(2, centre[1]), np.zeros(2)], axis=1)
    near, far = level(renderer, points, 0.0)
    assert (near < 0.9 * far).all()


def test_dust_in_the_air_takes_over_with_distance():
    renderer = shader(sun=towards(40, 10), optical_depth=1.0)
    far = np.array([[0.0, DUST_SCALE_HEIGHT, 0.0], [0.0, 20 * DUST_SCALE_HEIGHT, 0.0]])
    sky = renderer.sky((far - EYE) / np.linalg.norm(far - EYE, axis=1, keepdims=True))
    dark = level(renderer, far, 0.0)
    ground = (dark[0] - sky[0] * (1 - np.exp(-1))) / np.exp(-1)
    assert ((ground > 0) & (ground < 0.2)).all()  # Beer and Lambert: 1 / e is left after an optical depth of one
    assert np.allclose(dark[1], sky[1], atol=1e-5)


def test_the_same_seed_gives_the_same_light():
    points = around()
    first, same, other = (level(Shader(build_scene(SMALL, np.random.default_rng(seed))), points) for seed in (7, 7, 8))
    assert np.array_equal(first, same) and not np.allclose(first, other)
    assert not np.allclose(level(shader(texture_seed=1), points), level(shader(texture_seed=2), points))


def test_texture_is_as_strong_as_asked_for():
    points = np.random.default_rng(1).uniform(-0.4, 0.4, (4000, 3)) * [1, 1, 0] + [2, 0, 0]
    spread = [
        (lambda colour: colour.std() / colour.mean())(
            level(shader(sun=towards(40, 0), texture_strength=s, albedo_contrast=s), points)[:, 0]
        )
        for s in (0.0, 0.4, 1.2)
    ]
    assert spread[0] < 0.08 and spread[1] > 2 * spread[0] and spread[2] > 1.7 * spread[1]


def test_both_eyes_see_one_world():
    points = around(2000, 2.0, 6.0)
    left, right = level(shader(), points), level(shader(), points, eye=EYE + np.array([0.27, 0, 0]))
    assert np.abs(right / left - 1).mean() < 0.02 < left.std() / left.mean()
    assert np.corrcoef(left[:, 0], right[:, 0])[0, 1] > 0.98


@pytest.mark.parametrize("count", [0, 1])
def test_few_points_are_no_error(count):
    renderer = shader()
    assert renderer.sky(np.zeros((count, 3)) + np.array([0.0, 0.0, 1.0])).shape == (count, 3)
    assert level(renderer, around(count)).shape == (count, 3)
