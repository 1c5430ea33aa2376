from dataclasses import replace

import numpy as np
import pytest

from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.base.dataset.sample import StereoSample
from marssim.base.images.colours import depth_colours
from marssim.generation import contact_sheet as module
from marssim.generation.contact_sheet import contact_sheet

SIDE = 24


def sample(value: int) -> StereoSample:
    depth = np.full((SIDE, SIDE), 5.0, np.float32)
    normal = np.zeros((SIDE, SIDE, 3), np.float32)
    normal[..., 2] = -1
    image = np.full((SIDE, SIDE, 3), value, np.uint8)
    nothing = np.zeros((SIDE, SIDE), bool)
    return StereoSample(
        image, image, depth, depth, normal, ~nothing, nothing, nothing.astype(np.int32), NATECAM.resized(SIDE, SIDE), {}
    )


def runs_of(sheet: np.ndarray, colour: int) -> list[int]:
    """Return the first columns of the squares of one grey level, in any row."""
    here = (sheet == colour).all(axis=-1).sum(axis=0) >= SIDE
    return np.flatnonzero(np.diff(here.astype(int), prepend=0) == 1).tolist()


@pytest.mark.parametrize(("count", "bands"), [(1, 1), (3, 1), (4, 2), (6, 2)])
def test_every_sample_has_its_place(count, bands):
    """Each sample has a column with both eyes, in the order of the names; every third one begins a new band."""
    samples, names = [sample(40 + 30 * n) for n in range(count)], [f"{n:05d}/00" for n in range(count)]
    sheet = contact_sheet(samples, names, columns=3, tile=SIDE)
    one = contact_sheet(samples[:1], names[:1], columns=3, tile=SIDE)
    assert sheet.dtype == np.uint8 and sheet.shape[2] == 3
    if bands == 2:
        single = contact_sheet(samples[:3], names[:3], columns=3, tile=SIDE)
        assert sheet.shape[1] == single.shape[1] and sheet.shape[0] > 1.4 * single.shape[0]
    places = [runs_of(sheet, 40 + 30 * n)[0] for n in range(count)]
    assert places[:3] == sorted(places[:3]) and places[3:] == places[: max(0, count - 3)]
    for n in range(count):
        assert (sheet == 40 + 30 * n).all(axis=-1).sum() >= 2 * SIDE * SIDE  # both eyes
    assert one.shape[1] <= sheet.shape[1]


def test_samples_bear_their_names_and_rows_what_they_show():
    sheets = [contact_sheet([sample(90)], [name], tile=96) for name in ("00000/00", "00000/00", "00123/07")]
    assert np.array_equal(sheets[0], sheets[1])
    differs = np.argwhere((sheets[0] != sheets[2]).any(axis=-1))
    assert len(differs) and differs[:, 0].max() < 20  # in the first line alone
    edge = sheets[0][:, :20]
    assert (edge.max(axis=(1, 2)) > 200).sum() > 60  # of 4 x 96 rows


def test_the_scale_of_depth_is_below():
    sheet = contact_sheet([sample(90)], ["00000/00"], tile=96)
    near, far = depth_colours(np.array([[1.0, 15.0]]))[0]
    for colour in (near, far):
        assert (sheet[-150:] == colour).all(axis=-1).sum() >= 10


def test_the_legend_tells_that_the_sheet_shows_a_part(monkeypatch):
    texts = []
    monkeypatch.setattr(module, "_write", lambda image, text, at, size=0.4: texts.append(text))
    samples, names = [sample(90), sample(90)], ["00000/00", "00000/01"]
    for total, part in ((None, False), (2, False), (9, True)):
        texts.clear()
        contact_sheet(samples, names, total=total)
        assert ("2 of 9 pairs" in " ".join(texts)) == part


def test_a_sample_without_a_sun_that_is_a_number_is_drawn():
    """Another program may have written the dataset."""
    for sun in (None, "30", 12.5):
        assert contact_sheet([replace(sample(90), meta={"sun_elevation_deg": sun})], ["a"], tile=SIDE).std() > 1


def test_other_proportions_are_kept():
    wide = replace(
        sample(200),
        **{name: getattr(sample(200), name)[: SIDE // 2] for name in ("left", "right", "depth", "normal")},
    )
    tile = 8 * SIDE
    low, high = (contact_sheet([one], ["a"], tile=tile) for one in (wide, sample(200)))
    assert low.shape[0] < high.shape[0]
    assert (low == 200).all(axis=-1).sum() >= tile * tile  # two images of half the height


def shape_of(height: int, width: int) -> StereoSample:
    """Return a sample of images of a size."""
    maps = {"depth": np.full((height, width), 5.0, np.float32)}
    maps |= {name: np.resize(getattr(sample(200), name), (height, width, 3)) for name in ("left", "right", "normal")}
    return replace(sample(200), **maps)


def test_narrow_images_are_not_drawn_higher_than_two_tiles():
    sheet = contact_sheet([shape_of(200, 10)] * 2, ["a", "b"], tile=96)
    assert sheet.shape[0] < 4 * 2 * 96 + 200
    assert (sheet == 200).all(axis=-1).sum() >= 4 * 192 * 9  # both eyes of both, at their own proportions


def test_rows_of_low_images_leave_room_for_their_names(monkeypatch):
    places = []
    monkeypatch.setattr(module, "_write", lambda image, text, at, size=0.4: places.append((text, at, image.shape)))
    contact_sheet([shape_of(2, 40)], ["a"], tile=96)
    rows = [place for place in places if place[0] in module.ROWS]
    assert {text for text, *_ in rows} == set(module.ROWS)
    for text, (x, _), (_, width, _) in rows:
        assert x >= 0 and x + module._text_width(text) <= width


def test_depths_under_a_metre_get_a_scale_of_their_own(monkeypatch):
    texts = []
    monkeypatch.setattr(module, "_write", lambda image, text, at, size=0.4: texts.append(text))
    near = sample(90)
    near.depth[:] = np.linspace(0.22, 0.45, SIDE)
    contact_sheet([near], ["a"])
    assert {"0.2", "0.3", "0.5"} <= set(texts) and "15" not in texts
    assert any("grey beyond 0.5 m" in text for text in texts)


def test_no_samples_make_no_sheet():
    with pytest.raises(ValueError, match="at least one"):
        contact_sheet([], [])


def test_a_sheet_of_all_pairs_is_not_called_a_part(monkeypatch):
    flat, image = np.full((6, 8), 5, np.float32), np.zeros((6, 8, 3), np.uint8)
    rig = StereoRig(PinholeCamera.centred(8, 6, 9.0), 0.2)
    sample = StereoSample(image, image, flat, flat, image.astype(np.float32), flat > 0, flat < 0, flat * 0, rig, {})
    written, write = [], module._write
    monkeypatch.setattr(module, "_write", lambda image, text, *rest: written.append(text) or write(image, text, *rest))
    for total, is_part in ((3, True), (2, False), (None, False)):
        written.clear()
        module.contact_sheet([sample] * 2, ["0/0", "0/1"], total=total)
        assert any("pairs" in text for text in written) == is_part
