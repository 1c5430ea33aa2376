import numpy as np

from m3depth.rectification.matches import _nearest


def test_a_point_far_from_the_row_is_no_match_however_alike_it_is():
    places = np.array([[5.0, 10], [5, 30], [5, 100]])
    one, two, three = np.eye(3)
    alike = (one + 0.3 * two) / np.linalg.norm(one + 0.3 * two)
    left = np.array([one, two, three])
    right = np.array([alike, two, one])  # the point in row 100 looks like that of row 10
    best, certain = _nearest(places, left, places, right, 25.0)
    assert best[0] == 0 and certain[0]
