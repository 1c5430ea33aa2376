import numpy as np
import pytest

from marssim.render.relief.stones import bodies
from marssim.render.relief.stones.bodies import (
    BARE,
    CELLS,
    GRAVEL,
    MIDDLE,
    PACKED,
    RANK,
    REACH,
    RISE,
    SHAPE,
    SHAPES,
    SIDE,
    SIZE,
    SIZES,
    TIGHT,
    TONE,
    TOP,
    TOPS,
    Stones,
    X,
    Y,
    draw_stones,
    placed_stones,
)


@pytest.fixture(scope="module")
def stones() -> Stones:
    return draw_stones(1)


OCTAVES = range(len(SIZES) - 1)


def members(stones: Stones, octave: int) -> np.ndarray:
    """(N, FIELDS) the stones of one octave."""
    size = stones.stone[:, SIZE]
    return stones.stone[(size >= np.float32(SIZES[octave])) & (size < np.float32(SIZES[octave + 1]))].astype(float)


@pytest.mark.parametrize("octave", OCTAVES)
def test_stones_lie_close_together_and_hardly_overlap(stones, octave):
    own = members(stones, octave)
    side = CELLS * SIZES[octave + 1]
    assert (np.pi / 4 * own[:, SIZE] ** 2).sum() / side**2 == pytest.approx(PACKED, abs=0.12)
    rng = np.random.default_rng(0)
    for k in rng.choice(len(own), 200, replace=False):
        away = np.abs(own[:, [X, Y]] - own[k, [X, Y]])
        away = np.minimum(away, side - away)
        least = 0.5 * TIGHT * (own[:, SIZE] + own[k, SIZE])
        least[k] = 0
        assert (np.hypot(*away.T) >= least * (1 - 1e-4)).all()


def test_ranks_are_uniform_and_tones_of_unit_variance(stones):
    for octave in OCTAVES:
        rank = members(stones, octave)[:, RANK]
        assert np.abs(np.sort(rank) - (np.arange(len(rank)) + 0.5) / len(rank)).max() < 0.02
    assert stones.stone[:, TONE].std() == pytest.approx(1, abs=0.02)
    assert (np.diff(np.unique(stones.stone[:, SHAPE])) == 1).all() and stones.stone[:, SHAPE].max() == SHAPES - 1


@pytest.mark.parametrize("octave", OCTAVES)
def test_every_stone_is_registered_in_all_cells_that_it_reaches(stones, octave):
    cell = SIZES[octave + 1]
    first = octave * (CELLS * CELLS + 1)
    of_octave = np.flatnonzero(
        (stones.stone[:, SIZE] >= np.float32(SIZES[octave])) & (stones.stone[:, SIZE] < np.float32(cell))
    )
    rng = np.random.default_rng(0)
    for m in rng.choice(of_octave, 200, replace=False):
        x, y, reach = stones.stone[m, [X, Y, REACH]].astype(float)
        angle, radius = rng.uniform(0, 2 * np.pi, 60), 0.999 * reach * np.sqrt(rng.uniform(0, 1, 60))
        radius[:30] = 0.999 * reach
        i, j = (np.floor((at + radius * turn) / cell).astype(int) % CELLS for at, turn in (
            (x, np.cos(angle)), (y, np.sin(angle))
        ))  # fmt: skip
        for at in np.unique(first + j * CELLS + i):
            entries = np.arange(stones.start[at], stones.start[at + 1])
            own = entries[stones.member[entries] == m]
            assert len(own) == 1
            rank, place, most = stones.entry[own[0], 0], stones.entry[own[0], 1:3], stones.entry[own[0], 3]
            assert (rank, most) == pytest.approx((stones.stone[m, RANK], reach / cell))
            corner = np.array([(at - first) % CELLS, (at - first) // CELLS])
            around = (corner + place - np.array([x, y]) / cell + CELLS / 2) % CELLS - CELLS / 2
            assert around == pytest.approx([0, 0], abs=1e-4) and (np.abs(place - 0.5) <= most + 0.501).all()


def test_the_stones_of_a_cell_are_in_the_order_of_their_ranks(stones):
    for octave in OCTAVES:
        first = octave * (CELLS * CELLS + 1)
        for cell in np.random.default_rng(0).integers(0, CELLS * CELLS, 300):
            own = stones.member[stones.start[first + cell] : stones.start[first + cell + 1]]
            assert (np.diff(stones.stone[own, RANK]) >= 0).all()
            assert (stones.stone[own, SIZE] <= stones.octave[octave, SIDE]).all()


def test_stones_are_sunk_into_the_ground_and_none_is_higher_than_its_octaves_top(stones):
    top = 1 / stones.stone[:, RISE] + stones.stone[:, MIDDLE]
    assert (stones.stone[:, MIDDLE] < 0).all() and (top > 0).all()
    for octave in OCTAVES:
        own = members(stones, octave)
        highest = (1 / own[:, RISE] + own[:, MIDDLE]).max()
        assert highest == pytest.approx(stones.octave[octave, TOP], rel=1e-5) and highest < 0.6 * SIZES[octave + 1]


def test_the_tops_of_cells_are_those_of_the_highest_stones_that_lie_in_the_scene(stones):
    octave = stones.octave.copy()
    octave[:, BARE], octave[-1, BARE] = 0.2, 0
    placed = placed_stones(stones, octave)
    top = 1 / stones.stone[:, RISE] + stones.stone[:, MIDDLE]
    for n in OCTAVES:
        first = n * (CELLS * CELLS + 1)
        for cell in range(first, first + CELLS * CELLS, 37):
            own = stones.member[stones.start[cell] : stones.start[cell + 1]]
            lying = top[own[stones.stone[own, RANK] <= octave[n, BARE]]]
            code = float(placed.top[cell]) * octave[n, TOP] / TOPS
            highest = lying.max() if len(lying) and octave[n, BARE] > 0 else 0.0
            assert highest <= code * (1 + 1e-5) and code <= highest + 1.01 * octave[n, TOP] / TOPS
    assert placed.top.any() and not stones.top.any()


def test_planes_cut_some_shapes_and_leave_others_round(stones):
    normal, offset = stones.planes[..., :3], stones.planes[..., 3]
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
    cuts = (offset < 1).sum(axis=1)
    assert (cuts == 0).any() and (cuts >= 4).any() and offset.min() > 0.5


def test_a_draw_lays_no_stones_until_a_scene_says_how_many(stones):
    assert not stones.octave[:, [BARE, GRAVEL]].any()
    assert len(draw_stones(2).stone) != len(stones.stone)


def test_stones_from_a_file_are_those_that_are_drawn(stones):
    draw_stones.cache_clear()  # the file is there by now, where the package's folder or the user's can be written
    again, drawn = draw_stones(1), bodies._drawn_stones(1)
    for name, array in stones._asdict().items():
        assert np.array_equal(array, getattr(again, name)) and np.array_equal(array, drawn[name]), name
        assert array.dtype == getattr(again, name).dtype == drawn[name].dtype
