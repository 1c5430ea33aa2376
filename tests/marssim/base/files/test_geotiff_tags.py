"""The tags of GeoTIFF; tests/marssim/scene/test_heightmap.py reads them with their heights."""

import pytest

from marssim.base.files.geotiff_tags import read_geotiff_tags


def test_a_big_endian_bigtiff_says_what_to_do(tmp_path):
    path = tmp_path / "map.tif"
    path.write_bytes(b"MM\x00+\x00\x08\x00\x00" + bytes(8))
    with pytest.raises(ValueError, match=r"^map: its tags cannot be read \(it is a big-endian BigTIFF: save it as lit"):
        read_geotiff_tags(str(path), "map", "scale", True)
