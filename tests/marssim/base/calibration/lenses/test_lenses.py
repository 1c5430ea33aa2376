"""Lens models: projection and rays are inverse, and agree with OpenCV's and with each other."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from marssim.base.calibration.cameras import from_vectors
from marssim.base.calibration.lenses.cahvore import Cahvore, linearity_of
from marssim.base.calibration.lenses.curve import RisingCurve
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.radial_tangential import RadialTangential

PINHOLE = (612.0, 605.0, 330.5, 236.25)
NAVCAM = {
    "c": (0.946142, 0.346313, -1.89647), "a": (0.833361, 0.00929845, 0.552666), "h": (533.63, 745.615, 355.864),
    "v": (-4.25495, 2.73897, 884.46), "o": (0.83329, 0.0107144, 0.552747), "r": (1.736e-06, 0.0501396, -0.0171254),
}  # fmt: skip

small = st.floats(-0.05, 0.05)
tiny = st.floats(-0.003, 0.003)
points_ahead = arrays(
    np.float64, (7, 3), elements=st.floats(-0.5, 0.5)
).map(lambda p: (p + np.array([0, 0, 1])) * 3)  # within 45 deg of the axis, 1.5 to 4.5 m ahead  # fmt: skip


@st.composite
def radial_tangential(draw):
    count = draw(st.sampled_from([0, 4, 5, 8, 12]))
    terms = [draw(small), draw(small), draw(tiny), draw(tiny), draw(small)]
    terms += [draw(small) for _ in range(3)] + [draw(tiny) for _ in range(4)]
    return RadialTangential(*PINHOLE, tuple(terms[:count]))


fisheyes = st.builds(Fisheye, *map(st.just, PINHOLE), st.tuples(small, small, tiny, tiny), st.sampled_from([0.0, 0.01]))


@st.composite
def cahvores(draw):
    linearity = linearity_of(draw(st.sampled_from([1, 2, 3])), draw(st.floats(-0.9, 1.0)))
    off = np.array([draw(tiny), draw(tiny), 1.0])
    e = (draw(tiny), draw(tiny), draw(tiny))
    r = (draw(tiny), draw(small), draw(small))
    h, v = (600.0, draw(tiny), 330.0), (draw(st.floats(-1, 1)), 605.0, 240.0)
    return Cahvore((0.0, 0.0, 1.0), h, v, tuple(off / np.linalg.norm(off)), r, e, linearity)


any_lens = st.one_of(radial_tangential(), fisheyes, cahvores())


@settings(max_examples=200, deadline=None)
@given(any_lens, points_ahead, st.floats(0.5, 50))
def test_rays_of_a_pixel_pass_through_what_it_shows(lens, points, distance):
    pixels = lens.project(points)
    seen = np.isfinite(pixels).all(-1)
    rays = lens.rays(pixels[seen])
    across = np.cross(points[seen] - rays.origin, rays.direction)
    assert np.abs(across).max(initial=0) < 1e-8
    assert np.abs(lens.project(rays.at(distance)) - pixels[seen]).max(initial=0) < 1e-6
    assert np.abs(np.linalg.norm(rays.direction, axis=-1) - 1).max(initial=0) < 1e-12


@settings(max_examples=100, deadline=None)
@given(radial_tangential(), points_ahead)
def test_radial_tangential_is_that_of_opencv(lens, points):
    k = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    theirs, _ = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), k, np.array(lens.coefficients))
    ours = lens.project(points)
    seen = np.isfinite(ours).all(-1)
    assume(seen.mean() > 0.5)  # a lens may fold before 45 deg
    assert np.abs(ours[seen] - theirs[seen, 0]).max() < 1e-8


@settings(max_examples=100, deadline=None)
@given(fisheyes, points_ahead)
def test_fisheye_is_that_of_opencv(lens, points):
    k = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    theirs, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), k, np.array(lens.coefficients), alpha=lens.skew
    )
    ours = lens.project(points)
    seen = np.isfinite(ours).all(-1)
    assume(seen.mean() > 0.5)  # a lens may fold before 45 deg
    assert np.abs(ours[seen] - theirs[seen, 0]).max() < 1e-6


@settings(max_examples=100, deadline=None)
@given(points_ahead, st.tuples(tiny, small, small))
def test_cahvor_is_cahvore_of_type_1_without_entrance_pupil_terms(points, r):
    """Against the formula that CAHVOR was published with, mu = R0 + R1 tau + R2 tau^2 of tau = (lambda / zeta)^2."""
    lens = Cahvore((0, 0, 1), (600.0, 0.5, 330.0), (0.25, 605.0, 240.0), (0.0, 0.0, 1.0), r)
    zeta, side = points[:, 2:], points * [1, 1, 0]
    tau = (side**2).sum(-1, keepdims=True) / zeta**2
    moved = points + (r[0] + r[1] * tau + r[2] * tau**2) * side
    wanted = np.stack([moved @ lens.h, moved @ lens.v], -1) / moved[:, 2:]
    assert np.abs(lens.project(points) - wanted).max() < 1e-9


def test_a_straight_cahv_is_a_pinhole():
    lens = Cahvore((0, 0, 1), (612.0, 0, 330.5), (0, 605.0, 236.25), (0, 0, 1))
    points = np.random.default_rng(1).normal(size=(50, 3)) + np.array([0, 0, 5])
    assert np.allclose(lens.project(points), RadialTangential(*PINHOLE).project(points), atol=1e-10)
    assert lens.focal() == pytest.approx(RadialTangential(*PINHOLE).focal())


def test_the_vectors_of_a_rover_give_its_camera():
    """A point is projected alike by the model's vectors in the rover's frame and by our lens in the camera's."""
    camera = from_vectors(**NAVCAM, e=(-8.0e-09, 1.0e-08, -2.9e-08), linearity=0.0, size=(1280, 960))
    c, a, h, v, o = (np.array(NAVCAM[name]) for name in "cahvo")
    o = o / np.linalg.norm(o)
    point = c + 4.0 * (a + np.array([0.02, 0.2, -0.1]))
    p = point - c
    zeta = p @ o
    side = p - zeta * o
    theta = np.arctan2(np.linalg.norm(side), zeta)
    mu = NAVCAM["r"][0] + NAVCAM["r"][1] * theta**2 + NAVCAM["r"][2] * theta**4
    moved = np.linalg.norm(side) / theta * o + (1 + mu) * side
    assert camera.project(point) == pytest.approx([moved @ h / (moved @ a), moved @ v / (moved @ a)], abs=1e-3)
    assert camera.rays(np.array([640.0, 480.0])).direction @ a > 0.99


def test_a_lens_does_not_see_what_lies_behind_it_or_folds_back():
    barrel = RadialTangential(*PINHOLE, (-0.3, 0.0, 0.0, 0.0))
    turn = 1 / np.sqrt(0.9)  # where 1 - 3 * 0.3 r^2 = 0
    assert np.isfinite(barrel.project(np.array([0.99 * turn, 0, 1.0]))).all()
    for unseen in ([1.01 * turn, 0, 1.0], [0.1, 0.1, -1.0], [0, 0, 0]):
        assert np.isnan(barrel.project(np.array(unseen))).all()
    beyond = barrel.rays(np.array([PINHOLE[2] + 700.0, PINHOLE[3]]))  # farther out than any point is shown
    assert np.isnan(beyond.direction).all()
    assert np.isfinite(Fisheye(*PINHOLE).project(np.array([1.0, 0, -0.1]))).all()  # a fisheye sees beyond 90 deg


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: RadialTangential(*PINHOLE, (0.1, 0.2)), "0, 4, 5, 8 or 12 coefficients, got 2"),
        (lambda: RadialTangential(*PINHOLE, (0.0,) * 13 + (0.1,)), "tilted detector"),
        (lambda: RadialTangential(-1.0, 600, 0, 0), "focal lengths must be positive"),
        (lambda: Fisheye(*PINHOLE, (0.1,)), "4 coefficients of distortion, got 1"),
        (lambda: linearity_of(4), "must be 1, 2 or 3, is 4"),
        (lambda: linearity_of(3, 2.0), "must be -1 to 1, is 2"),
        (lambda: from_vectors(np.zeros(3), NAVCAM["a"], NAVCAM["h"], [-x for x in NAVCAM["v"]]), "left-handed"),
        (lambda: from_vectors(np.zeros(3), [0, 0, 2], NAVCAM["h"], NAVCAM["v"]), "vector A .* length 1, has 2"),
        (lambda: from_vectors(np.zeros(3), [0, 0, 1], [0, 0, 5], NAVCAM["v"]), "A and H .* parallel"),
    ],
)
def test_what_is_no_lens_is_refused(build, says):
    with pytest.raises(ValueError, match=says):
        build()


def test_a_curve_ends_where_it_turns_back():
    assert RisingCurve((1.0, -1.0)).limit == pytest.approx(np.sqrt(1 / 3))
    assert RisingCurve((1.0,), (-1.0,)).limit == pytest.approx(1.0)  # its pole
    assert RisingCurve((1.0, 0.5)).limit == 100
    assert RisingCurve((-1.0,)).limit == 0
    assert RisingCurve((1e-10, 0.0, 0.0)).limit == 100  # it hardly rises, and never turns
    curve = RisingCurve((1.0, 0.2, 0.03))
    t = np.linspace(0, 20, 100)
    assert np.abs(curve.inverse(curve(t)) - t).max() < 1e-10
