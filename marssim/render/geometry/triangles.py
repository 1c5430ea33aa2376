"""One triangle in the image plane of an eye or of the sun, and its intersection with rays.

A corner is projected to (X, Y, W, S), see projection.py. The test of an image point against the edges is that of its
ray against the triangle, in float64. Neighbours share their edges, so no ray falls between them. All values are tuples,
because the compiler keeps tuples in registers but not arrays.
"""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.geometry.projection import NEAREST


@inlined
def project(x, y, z, view):
    """Return X, Y, W, S of a world point. view: 16 numbers, see Projection.numbers."""
    return (
        view[0] * x + view[1] * y + view[2] * z + view[12],
        view[3] * x + view[4] * y + view[5] * z + view[13],
        view[6] * x + view[7] * y + view[8] * z + view[14],
        view[9] * x + view[10] * y + view[11] * z + view[15],
    )


@inlined
def corners(vertices, faces, face, view):
    """Return X, Y, W, S of each corner of a face."""
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    return (
        project(vertices[i, 0], vertices[i, 1], vertices[i, 2], view),
        project(vertices[j, 0], vertices[j, 1], vertices[j, 2], view),
        project(vertices[k, 0], vertices[k, 1], vertices[k, 2], view),
    )


@inlined
def _across(a, b):
    """Return the image point x, y where the side a b crosses the plane W = NEAREST, and the error of either."""
    t = (NEAREST - a[2]) / (b[2] - a[2])
    u, v = (a[0] + t * (b[0] - a[0])) / NEAREST, (a[1] + t * (b[1] - a[1])) / NEAREST
    return u, v, 1e-6 * (abs(u) + abs(v))


@inlined
def extent(a, b, c):
    """Return left, right, top, bottom of the part of the image plane that a triangle may cover.

    a, b, c: corners X, Y, W, S. left is inf if the whole triangle lies behind the eye.
    """
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    if a[2] >= NEAREST and b[2] >= NEAREST and c[2] >= NEAREST:
        ia, ib, ic = 1 / a[2], 1 / b[2], 1 / c[2]
        ax, bx, cx, ay, by, cy = a[0] * ia, b[0] * ib, c[0] * ic, a[1] * ia, b[1] * ib, c[1] * ic
        left, right = min(ax, min(bx, cx)), max(ax, max(bx, cx))
        top, bottom = min(ay, min(by, cy)), max(ay, max(by, cy))
    else:
        for p, q in ((a, b), (b, c), (c, a)):
            if p[2] >= NEAREST:
                u, v = p[0] / p[2], p[1] / p[2]
                left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
            if (p[2] >= NEAREST) != (q[2] >= NEAREST):
                u, v, slack = _across(p, q)
                left, right = min(left, u - slack), max(right, u + slack)
                top, bottom = min(top, v - slack), max(bottom, v + slack)
    return left, right, top, bottom


@inlined
def box_extent(low, high, view):
    """Return the `extent` of an axis-aligned box low, high (3,), and the least S of its corners.

    It is the whole plane if a part of the box lies behind the eye; left is inf if all of it does.
    """
    left, right, top, bottom, first = np.inf, -np.inf, np.inf, -np.inf, np.inf
    behind, front = False, False
    for n in range(8):
        x, y, z = high[0] if n & 1 else low[0], high[1] if n & 2 else low[1], high[2] if n & 4 else low[2]
        p = project(x, y, z, view)
        first = min(first, p[3])
        if p[2] < NEAREST:
            behind = True
        else:
            front = True
            u, v = p[0] / p[2], p[1] / p[2]
            left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    if behind and front:
        left, right, top, bottom = -np.inf, np.inf, -np.inf, np.inf
    return left, right, top, bottom, first


@inlined
def facing(a, b, c):
    """Return the determinant of the corners' X, Y, W; its sign tells which side of the triangle is visible."""
    return (b[1] * c[2] - b[2] * c[1]) * a[0] + (b[2] * c[0] - b[0] * c[2]) * a[1] + (b[0] * c[1] - b[1] * c[0]) * a[2]


@inlined
def _edge(a, b):
    """Return the edge function of side a b: its three factors of (x, y, 1)."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def edges(a, b, c):
    """Return the triangle as `meet` takes it, and the least S of its corners. a, b, c: corners X, Y, W, S.

    The triangle consists of the edge functions opposite to the corners and the S of the corners.
    """
    return (_edge(b, c), _edge(c, a), _edge(a, b), a[3], b[3], c[3]), min(a[3], min(b[3], c[3]))


@inlined
def meet(triangle, x, y):
    """Return S where the ray (x, y) hits a triangle of `edges`, inf where it misses. Both neighbours own an edge."""
    ea, eb, ec, sa, sb, sc = triangle
    wa = ea[0] * x + ea[1] * y + ea[2]
    wb = eb[0] * x + eb[1] * y + eb[2]
    wc = ec[0] * x + ec[1] * y + ec[2]
    total = wa + wb + wc
    if wa * wb < 0 or wa * wc < 0 or wb * wc < 0 or total == 0:
        return np.inf
    return (wa * sa + wb * sb + wc * sc) / total
