from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.base.dataset.frame import GROUND
from marssim.base.pose import look_pose
from marssim.inspection.tilted_planes import plane
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.renderers.scan_renderer import ScanRenderer
from marssim.render.surfaces.albedo import GROUND_COLOUR, ROCK_COLOUR
from marssim.render.surfaces.shading import DUSK, DUST_SCALE_HEIGHT, SKY_COLOUR, Shader
from marssim.scene.look import LOOK_LIMITS, LookConfig, draw_look
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

FOCAL = 600.0
SMALL = SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.1))
SCENE = build_scene(SMALL, np.random.default_rng(2))
LEVEL = plane(np.zeros(2))
EYE = np.array([0.0, 0.0, 1.2])
FOOTPRINT = Footprint(EYE, FOCAL)
PLAIN = {
    "texture_strength": 0.0, "pebbles": 0.0, "wind_ripples": 0.0, "bedrock": 0.0, "gravel": 0.0, "soil_albedo": 1.0,
}  # fmt: skip


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


def details(count: int, fine: float = 0.0, bare: float = 0.0, sunlight: float = 1.0) -> np.ndarray:
    """Return the details (N, 4) of ground without stones."""
    return np.tile(np.float32([-1, fine, bare, sunlight]), (count, 1))


def shade(renderer: Shader, points, normals, surface, lit, detail=None, eye: np.ndarray = EYE) -> np.ndarray:
    detail = details(len(points)) if detail is None else detail
    return renderer.surface(points, normals, surface, detail, eye, lit, FOOTPRINT)


def level(renderer: Shader, points: np.ndarray, lit: float = 1.0, eye: np.ndarray = EYE, **detail) -> np.ndarray:
    count = len(points)
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    return shade(
        renderer, points, up, np.full(count, GROUND), np.full(count, lit), details(count, **detail), eye
    )  # fmt: skip


def seen(x: float, count: int = 4000, spread: float = 0.4, **look) -> tuple[np.ndarray, np.ndarray]:
    """Return the radiance (N, 3) and the details (N, 4) of level ground about x, 0 as a camera sees it from above."""
    scene = replace(LEVEL, look=replace(SCENE.look, **look))
    renderer = ScanRenderer(scene)
    pose = look_pose(np.array([x - 1.0, 0.0, 1.2]), 0.0, np.deg2rad(50))
    rays = np.ones((count, 3))
    rays[:, :2] = np.random.default_rng(1).uniform(-spread, spread, (count, 2))
    footprint = Footprint(pose[:3, 3], FOCAL)
    hits = renderer.trace(rays, pose, footprint)
    points = pose[:3, 3] + hits.depth[:, None] * (rays @ pose[:3, :3].T)
    radiance = Shader(scene).surface(
        points, hits.shading_normal, hits.surface, hits.detail, pose[:3, 3], np.ones(count), footprint
    )
    assert (hits.surface == GROUND).all()
    return radiance, hits.detail


def contrast(x: float, **look) -> float:
    """Return the standard deviation of the red radiance of ground as a camera sees it, over its mean."""
    red = seen(x, **look)[0][:, 0]
    return float(red.std() / red.mean())


@settings(max_examples=20)  # each makes a shader of the whole scene
@given(elevation=st.floats(10, 89), depth=st.floats(0.1, 2.0))
def test_what_the_sun_reaches_is_brighter(elevation, depth):
    renderer = shader(sun=towards(elevation, 40), optical_depth=depth)
    points = around()
    dark, half, lit = (level(renderer, points, share) for share in (0.0, 0.5, 1.0))
    assert (lit > dark).all()
    assert np.allclose(half, (lit + dark) / 2, atol=1e-5)
    assert np.allclose(level(renderer, points, sunlight=0.5), half, atol=1e-6)  # in the shadow of a stone
    assert (dark > 0).all()  # shadows are filled by the sky


@settings(max_examples=25)
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
    detail = np.stack(
        [rng.integers(-1, 1000, 300), rng.normal(0, 0.01, 300), *rng.uniform(0, 1, (2, 300))], axis=1
    ).astype(np.float32)
    radiance = shade(renderer, points, normals, surface, rng.uniform(0, 1, 300), detail)
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
    radiance = shade(renderer, points, normals, np.zeros(3, int), np.ones(3))
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
    colour = shade(renderer, points, faces, np.array([dark + 1, bright + 1]), np.ones(2))
    expected = SCENE.rocks.albedo[bright] / SCENE.rocks.albedo[dark]
    assert np.allclose(colour[1] / colour[0], expected, rtol=0.02)
    ground = shade(renderer, points[:1], faces[:1], np.array([GROUND]), np.ones(1))[0]
    assert ground[0] / ground[2] > 1.2 * colour[0, 0] / colour[0, 2]  # the ground is redder than bare rock


def test_wind_ripples_pebbles_and_gravel_come_and_go_with_their_knobs():
    plain = {**PLAIN, "sun": towards(30, 0), "albedo_contrast": 0.0}
    knobs = ({}, {"pebbles": 1.0}, {"wind_ripples": 1.0, "texture_strength": 1.0}, {"gravel": 1.0})
    none, pebbles, ripples, gravel = (contrast(2.0, **{**plain, **knob}) for knob in knobs)
    # ripples have RMS slopes of 0.03 to 0.11, too low for more contrast under this sun
    assert none < 0.05 and min(pebbles, gravel) > 0.08 + none and ripples > 0.015 + none


def test_dust_clings_to_the_sides_of_some_rocks_as_much_as_its_knob_says():
    count = len(SCENE.rocks)
    faces, points = np.tile([-1.0, 0.0, 0.0], (count, 1)), np.tile([2.0, 0.0, 3.0], (count, 1))
    reds = []
    for dust in (0.0, 0.4, 0.9):
        renderer = shader(sun=towards(40, 180), albedo_contrast=0.0, texture_strength=0.0, rock_dust=dust)
        colour = shade(renderer, points, faces, np.arange(count) + 1, np.ones(count))
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
        dark = shade(renderer, points, up, surface, np.zeros(len(points)), eye=EYE + np.array([0, 0, 3.0]))
        assert dark.max() <= 0.92 * (renderer.light.skylight + 0.18 / 0.27 * 0.45 * renderer.light.sunlight.max())


def test_rocks_differ_in_colour_as_the_contrast_says():
    faces, points = np.tile([-1.0, 0.0, 0.0], (50, 1)), np.tile([2.0, 0.0, 3.0], (50, 1))
    spread = []
    for contrast in (0.0, 0.5, 1.0):
        renderer = shader(sun=towards(40, 180), albedo_contrast=contrast, texture_strength=0.0, rock_dust=0.0)
        colour = shade(renderer, points, faces, np.arange(50) + 1, np.ones(50))
        spread.append((colour[:, 0] / colour[:, 2]).std())
    assert spread[0] < 0.5 * spread[1] < 0.4 * spread[2]


def test_bedrock_is_paler_than_sand_and_shows_as_its_knob_says():
    plain = {**PLAIN, "sun": towards(50, 0), "albedo_contrast": 1.0, "texture_strength": 0.3}
    views = [seen(0.5, spread=0.9, **{**plain, "bedrock": share}) for share in (0.0, 0.2, 0.5, 1.0)]
    bare = [detail[:, 2].mean() for _, detail in views]
    assert bare[0] == 0 and (np.diff(bare[1:]) > 0.05).all() and bare[-1] > 0.3
    red = [(colour[:, 2] / colour[:, 0]).mean() for colour, _ in views]
    assert (np.diff(red[1:]) > 0).all() and red[-1] > red[0]  # sand is redder
    shader_of_bedrock = shader(bedrock=0.5, albedo_contrast=1.0)
    sand, rock = (level(shader_of_bedrock, around(), bare=share).mean(0) for share in (0.0, 1.0))
    assert rock[2] / rock[0] > 1.05 * sand[2] / sand[0]


def test_soil_is_as_bright_as_its_knob_says_and_bedrock_does_not_follow():
    plain = {**PLAIN, "sun": towards(50, 0), "albedo_contrast": 0.0, "bedrock": 0.5}
    sand, bare = (
        [level(shader(**{**plain, "soil_albedo": soil}), around(), bare=share)[:, 0].mean() for soil in (0.5, 1.0)]
        for share in (0.0, 1.0)
    )
    assert sand[0] == pytest.approx(0.5 * sand[1], rel=0.01)
    assert bare[0] == pytest.approx(bare[1], rel=0.01)  # it gets a little less light from the soil


def test_dark_soil_throws_less_light_on_the_walls_that_stand_on_it():
    wall, point = np.array([[-1.0, 0.0, 0.0]]), np.array([[2.0, 0.0, 0.3]])
    shaders = [shader(soil_albedo=soil, sun=towards(60, 0), optical_depth=0.1) for soil in (0.3, 0.65, 1.0)]
    light = [shade(each, point, wall, np.ones(1, int), np.zeros(1)) for each in shaders]
    assert light[0].mean() < 0.9 * light[2].mean()
    assert np.allclose(light[1] - light[0], light[2] - light[1], rtol=0.01)


def test_relief_shows_in_the_shadow_under_a_low_sun():
    """The sky is brighter on the sun's side, so that slopes towards it are brighter without sunlight, too."""
    tilt = np.deg2rad([-20, 20])
    normals = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], axis=1)
    points = np.tile([0.0, 2.0, 0.0], (2, 1))

    def ratio(elevation: float) -> float:
        renderer = shader(sun=towards(elevation, 0), texture_strength=0.0, albedo_contrast=0.0)
        away, facing = shade(renderer, points, normals, np.zeros(2, int), np.zeros(2))[:, 0]
        return facing / away

    assert ratio(15) > 1.3 and ratio(89) == pytest.approx(1, abs=0.02)


def test_stones_too_small_to_show_darken_the_ground_far_away():
    near, far = around(near=0.2, far=0.6), around(near=40.0, far=60.0)
    few, many = (shader(**{**PLAIN, "pebbles": share, "albedo_contrast": 0.0}) for share in (0.0, 1.0))
    change = [1 - (level(many, at, eye=EYE) / level(few, at, eye=EYE)).mean() for at in (near, far)]
    # they have most of their brightness from the soil, PEBBLE_SOIL, so that they differ from it mainly by their shadows
    assert 0 <= change[0] < 0.1 * change[1] and change[1] > 0.01


def test_a_stone_has_a_tone_of_its_own():
    renderer, points = shader(albedo_contrast=1.0, sun=towards(40, 180)), np.tile([2.0, 0.0, 0.0], (400, 1))
    detail = details(400)
    detail[:, 0] = np.arange(400)
    up = np.tile([0.0, 0.0, 1.0], (400, 1))
    red = shade(renderer, points, up, np.full(400, GROUND), np.ones(400), detail)[:, 0]
    assert 0.1 < red.std() / red.mean() < 0.6
    assert np.corrcoef(np.log(red), renderer._soil.tones[:400])[0, 1] > 0.9


def test_rocks_take_sky_from_the_ground_beside_them():
    renderer = shader(sun=towards(40, 180), albedo_contrast=0.0, texture_strength=0.0)
    inside = (np.abs(SCENE.rocks.centre[:, :2]) < SCENE.half - 1.5).all(axis=1)
    rock = int(np.argmax(SCENE.rocks.height * inside))
    centre, radius = SCENE.rocks.centre[rock], SCENE.rocks.diameter[rock] / 2
    points = np.stack([centre[0] - radius - np.array([0.05, 1.0]), np.full(2, centre[1]), np.zeros(2)], axis=1)
    near, far = level(renderer, points, 0.0)
    assert (near < 0.93 * far).all()


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
    plain = {**PLAIN, "sun": towards(40, 0)}
    spread = [contrast(2.0, **{**plain, "texture_strength": s, "albedo_contrast": s}) for s in (0.0, 0.4, 1.2)]
    assert spread[0] < 0.05 and spread[1] > 2 * spread[0] and spread[2] > 1.7 * spread[1]


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


BARE = {"albedo_contrast": 0.0, "texture_strength": 0.0, "rock_dust": 0.0, "soil_albedo": 1.0}


def of_rock(renderer: Shader, normal: np.ndarray, eye: np.ndarray, lit: float) -> np.ndarray:
    """Return the radiance (3,) of a bare side of a rock in the origin; eye: its direction."""
    point = np.zeros((1, 3))
    return shade(renderer, point, normal[None], np.ones(1, int), np.full(1, lit), eye=0.5 * eye)[0]


def reflected(normal: np.ndarray, sun: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return the sunlight (3,) that a rock reflects, over that which falls on it."""
    renderer = shader(sun=sun, optical_depth=0.3, **BARE)
    direct = of_rock(renderer, normal, eye, 1.0) - of_rock(renderer, normal, eye, 0.0)
    return direct / renderer.light.sunlight / (normal @ sun)


def test_sun_and_eye_may_change_places():
    """Helmholtz's reciprocity."""
    normal = towards(20, 30)
    for first, second in ((towards(70, 40), towards(10, 0)), (towards(30, 90), towards(50, -20))):
        assert (reflected(normal, first, second) > 0.05).all()
        np.testing.assert_allclose(reflected(normal, first, second), reflected(normal, second, first), rtol=1e-3)


def test_a_turn_of_all_about_the_vertical_changes_nothing():
    def seen_at(azimuth: float, lit: float) -> np.ndarray:
        renderer = shader(sun=towards(25, azimuth), optical_depth=0.6, **BARE)
        return of_rock(renderer, towards(10, azimuth + 50), towards(15, azimuth + 100), lit)

    for lit in (0.0, 1.0):
        turned = [seen_at(azimuth, lit) for azimuth in (0, 70, 160, 250)]
        np.testing.assert_allclose(turned, np.tile(turned[0], (4, 1)), rtol=1e-3)


def test_a_wall_in_shadow_has_the_colour_of_the_ground_without_dust_and_of_the_sky_in_a_storm():
    wall, eye = np.array([-1.0, 0.0, 0.0]), towards(0, 180)
    shadows = {
        name: of_rock(shader(sun=towards(elevation, 0), optical_depth=depth, **BARE), wall, eye, 0.0) / ROCK_COLOUR
        for name, elevation, depth in (("high", 90, 1e-6), ("low", 30, 1e-6), ("storm", 90, 12.0))
    }
    for name, colour in (("high", GROUND_COLOUR), ("low", GROUND_COLOUR), ("storm", SKY_COLOUR)):
        np.testing.assert_allclose(shadows[name] / shadows[name][0], np.divide(colour, colour[0]), rtol=0.02)
    np.testing.assert_allclose(shadows["low"], 0.5 * shadows["high"], rtol=1e-3)  # of light on level ground


def test_rocks_throw_light_on_the_ground_at_their_feet():
    """Without dust in the air, a shadow on open ground is black."""
    renderer = shader(sun=towards(40, 180), optical_depth=1e-6, **BARE)
    rock = int(np.argmax(SCENE.rocks.height * (np.abs(SCENE.rocks.centre[:, :2]) < SCENE.half - 1.5).all(axis=1)))
    x, y = SCENE.rocks.centre[rock, :2] - [SCENE.rocks.diameter[rock] / 2 + 0.05, 0]
    near, far = level(renderer, np.array([[x, y, 0.0], [x - 1.0, y, 0.0]]), 0.0)[:, 0]
    assert near > 0.01 and near > 2 * far
    lower = level(shader(sun=towards(20, 180), optical_depth=1e-6, **BARE), np.array([[x, y, 0.0]]), 0.0)[0, 0]
    assert lower / near == pytest.approx(np.sin(np.deg2rad(20)) / np.sin(np.deg2rad(40)), rel=0.01)


def test_shadows_of_hills_and_of_stones_multiply():
    renderer = shader(sun=towards(40, 40))
    points = around(20)
    dark, lit, both = (level(renderer, points, share, sunlight=of) for share, of in ((0, 1), (1, 1), (0.5, 0.4)))
    np.testing.assert_allclose(both - dark, 0.2 * (lit - dark), atol=1e-6)


def test_sunlight_fades_where_it_grazes_rocks_and_not_on_ground():
    renderer = shader(LEVEL, sun=towards(30, 0), **{**PLAIN, "albedo_contrast": 0.0})
    of_rocks = shader(sun=towards(30, 0), optical_depth=renderer.scene.look.optical_depth, **BARE)
    ratio = []
    for grazing_deg in (30, 2):
        normal = towards(grazing_deg - 60, 0)  # the sun stands so high over this face
        at = np.zeros((1, 3)), normal[None]
        direct = [
            np.subtract(*(shade(each, *at, np.array([surface]), np.full(1, lit), eye=normal) for lit in (1.0, 0.0)))
            for each, surface in ((of_rocks, 1), (renderer, GROUND))
        ]
        ratio.append((direct[0] / direct[1])[0, 0])
    assert ratio[1] / ratio[0] == pytest.approx(DUSK * np.sin(np.deg2rad(2)), rel=0.03)
