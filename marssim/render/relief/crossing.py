"""Where rays first meet the ground: its height field, and the stones on it.

A ray enters near the ground where it passes a mesh that lies above the relief everywhere. From there it advances to
the first crossing. A step is as long as the steepest slope allows, or a fraction of the shortest wave in view; the last
ones are Newton's. Stones are tested piece by piece, in the ray's height over the ground, which is nearly linear over a
piece.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.render.relief.height import around, cover_at, footprint_at, height_at, near_height, shown_at
from marssim.render.relief.stones import (
    AX,
    AY,
    BARE,
    BX,
    BY,
    CELLS,
    EAST,
    GRAVEL,
    MIDDLE,
    NORTH,
    PER_SIDE,
    PLANES,
    RANK,
    REACH,
    RISE,
    SAND_STONES,
    SHAPE,
    SIDE,
    SIZE,
    TOP,
    X,
    Y,
)  # fmt: skip
from marssim.render.relief.tiles import NONE, WHOLE

STEPS = 200  # steps after which a ray that still skims the ground is given up
STONE_NONE = 1.3  # pixels across a stone up to which it does not show
STONE_FLAT, STONE_WHOLE = 2.0, 8.0  # pixels up to which it is flat, a pattern, and from which on it has its height
FLATTEST = 0.02  # share of its height that even a flat stone has, so that rays find it
EDGE_ON = 1e-3  # least cosine between a normal and the direction towards the camera
OFF = 2e-4  # [m] distance from a surface at which rays to the sun start
LONGEST_SHADOW = 0.5  # [m] length of a ray to the sun that is followed among stones
SHADOW_STEPS = 3  # places over which the fine relief may hide the sun
SUN_RADIUS = 0.0031  # [rad] half the sun's angular diameter as seen from Mars
SHORT_WAVE = np.float32(0.1)  # [m] wave whose visibility stands for that of all fine relief
PIECE = np.float32(0.025)  # [m] length on the ground of the pieces of a ray that are tested for stones
AROUND = 0.08  # [m] how far from the middle of a model of the relief it is used
NEAR = 2e-4  # height over the ground, over the ray's length, from which the last step of a ray leads to it
EXACT = 1e-4  # the same of the exact relief, from which a step of Newton's gives the crossing
SKIM = 2e-5  # length of a step, over the ray's, after which a crossing with a stone is found


@inlined
def _enter(ox, oy, oz, dx, dy, dz, planes, shape, ahead):
    """Return where a ray enters a unit sphere cut by planes, and the plane that it enters by (-1 for the sphere).

    Only what lies at 0 to `ahead` counts; inf for a miss.
    """
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - 1
    root = b * b - a * c
    if root <= 0:
        return np.inf, -1
    root = math.sqrt(root)
    first, last, by = (-b - root) / a, (-b + root) / a, -1
    if first > ahead or last < 0:
        return np.inf, -1
    for n in range(PLANES):
        offset = planes[shape, n, 3]
        if offset >= 1:
            continue
        nx, ny, nz = planes[shape, n, 0], planes[shape, n, 1], planes[shape, n, 2]
        out = nx * ox + ny * oy + nz * oz - offset
        fall = nx * dx + ny * dy + nz * dz
        if fall == 0:
            if out > 0:
                return np.inf, -1
            continue
        where = -out / fall
        if fall < 0:
            if where > first:
                first, by = where, n
        elif where < last:
            last = where
    if first >= last or first < 0 or first > ahead:
        return np.inf, -1
    return first, by


@inlined
def _tallest(octave, open_ground, packed, footprint):
    """Return the height over the ground of the largest stones that may lie here and show [m]; 0 if none do."""
    for n in range(len(octave) - 1, -1, -1):
        if octave[n, SIDE] < np.float32(STONE_NONE) * footprint:
            break
        if octave[n, BARE] * open_ground + octave[n, GRAVEL] * packed > 0:
            return octave[n, TOP]
    return np.float32(0)


@inlined
def _most_stones(data, cover, x, y):
    """Return the greatest shares of bare ground's and of gravel's stones that may lie about x, y [m]."""
    sand, _, _, gravel, _ = cover_at(data, cover, np.float32(x), np.float32(y))
    open_ground = min(np.float32(1.15) - np.float32(SAND_STONES) * sand, np.float32(1))
    return open_ground, min(gravel + np.float32(0.15), np.float32(1)) if gravel > 0 else np.float32(0)


@inlined
def _stone_hit(
    data, cover, start, member, stone, planes, octave, eye, focal, footprint, open_ground, packed,
    x, y, z, g, dx, dy, dg, length,
):  # fmt: skip
    """Return the first stone that a piece of a ray meets.

    footprint: of pixels there [m]; open_ground, packed: of _most_stones; x, y, z, g: where the piece begins, world
    frame [m], and its height over the ground; dx, dy, dg: their growth per unit of the piece; length: of the piece.
    Returns where on the piece, the stone (-1 for none), the plane that it is entered by, the share of its height that
    shows, and its centre x, y in the world.
    """
    best, who, by, lift, cx, cy = length, -1, -1, np.float32(0), 0.0, 0.0
    last = np.int32(CELLS - 1)
    per_x, per_y = 1 / max(abs(dx), 1e-12), 1 / max(abs(dy), 1e-12)
    per_g = 1 / dg if dg != 0 else 0.0
    step_i, step_j = np.int32(1 if dx > 0 else -1), np.int32(1 if dy > 0 else -1)
    aside_most = dx * dx + dy * dy
    for n in range(len(octave) - 1, -1, -1):
        cell = octave[n, SIDE]
        if cell < np.float32(STONE_NONE) * footprint:
            break
        most = octave[n, BARE] * open_ground + octave[n, GRAVEL] * packed
        if most <= 0:
            continue
        top = octave[n, TOP]
        # the part of the piece below the stones' tops
        begin = 0.0 if g <= top else (top - g) * per_g if dg < 0 else np.inf
        limit = best if dg <= 0 else min(best, (top - g) * per_g)
        if begin >= limit:
            continue
        per_cell = octave[n, PER_SIDE]
        px, py = (x + begin * dx - octave[n, EAST]) * per_cell, (y + begin * dy - octave[n, NORTH]) * per_cell
        left, low = np.floor(px), np.floor(py)
        i, j = np.int32(left), np.int32(low)
        width_i, width_j = cell * per_x, cell * per_y
        next_i = begin + (1 - px + left if dx > 0 else px - left) * width_i
        next_j = begin + (1 - py + low if dy > 0 else py - low) * width_j
        here, first_cell = begin, n * (CELLS * CELLS + 1)
        while here < min(limit, best):
            at = first_cell + (j & last) * CELLS + (i & last)
            for entry in range(start[at], start[at + 1]):
                m = member[entry]
                if stone[m, RANK] > most:
                    break
                # the tile's copy that is nearest to the cell
                sx, sy = stone[m, X], stone[m, Y]
                sx += cell * (CELLS * np.floor((i + 0.5 - sx * per_cell) * (1 / CELLS) + 0.5)) + octave[n, EAST]
                sy += cell * (CELLS * np.floor((j + 0.5 - sy * per_cell) * (1 / CELLS) + 0.5)) + octave[n, NORTH]
                ox, oy = x - sx, y - sy
                # a ray that passes beside it, seen from above
                aside, reach = ox * dy - oy * dx, stone[m, REACH]
                if aside * aside > reach * reach * aside_most:
                    continue
                sand, _, _, gravel, _ = cover_at(data, cover, np.float32(sx), np.float32(sy))
                share = octave[n, BARE] * (1 - np.float32(SAND_STONES) * sand) + octave[n, GRAVEL] * gravel
                if stone[m, RANK] > share:
                    continue
                wide = footprint_at(eye, focal, sx, sy, z - g)
                if stone[m, SIZE] <= np.float32(STONE_NONE) * wide:
                    continue
                share = max(
                    shown_at(stone[m, SIZE], wide, np.float32(STONE_FLAT), np.float32(STONE_WHOLE)),
                    np.float32(FLATTEST),
                )
                rise = stone[m, RISE] / share
                first, plane = _enter(
                    stone[m, AX] * ox + stone[m, AY] * oy, stone[m, BX] * ox + stone[m, BY] * oy,
                    (g - share * stone[m, MIDDLE]) * rise,
                    stone[m, AX] * dx + stone[m, AY] * dy, stone[m, BX] * dx + stone[m, BY] * dy, dg * rise,
                    planes, np.int32(stone[m, SHAPE]), best,
                )  # fmt: skip
                if first < best:
                    best, who, by, lift, cx, cy = first, m, plane, share, sx, sy
            if next_i < next_j:
                here, i, next_i = next_i, i + step_i, next_i + width_i
            else:
                here, j, next_j = next_j, j + step_j, next_j + width_j
    return best, who, by, lift, cx, cy


@inlined
def _stone_side(stone, planes, m, by, lift, ox, oy, g):
    """Return how far a point is outside a stone's side, and its slopes along x, y and height over the ground.

    ox, oy: from the stone's centre [m]; g: height over the ground [m]; by: plane, or -1 for the ellipsoid.
    """
    rise = stone[m, RISE] / lift
    ax, ay, bx, by_ = stone[m, AX], stone[m, AY], stone[m, BX], stone[m, BY]
    u, v, w = ax * ox + ay * oy, bx * ox + by_ * oy, (g - lift * stone[m, MIDDLE]) * rise
    if by < 0:
        value = 0.5 * (u * u + v * v + w * w - 1)
        nu, nv, nw = u, v, w
    else:
        n = np.int32(stone[m, SHAPE])
        nu, nv, nw = planes[n, by, 0], planes[n, by, 1], planes[n, by, 2]
        value = nu * u + nv * v + nw * w - planes[n, by, 3]
    return value, nu * ax + nv * bx, nu * ay + nv * by_, nw * rise


@inlined
def first_crossing(data, relief, start, member, stone, planes, octave, steepest, eye, focal, origin, ray, begin, end):
    """Follow a ray from `begin` to its first crossing with the ground.

    Args:
        data: Of Ground.
        relief: Of Ground.
        start, member, stone, planes, octave: Of Stones.
        steepest: Slope that the relief hardly exceeds.
        eye: Position of the left camera [m].
        focal: Its focal length [px].
        origin: (x, y, z) of the ray's start [m], world frame.
        ray: (x, y, z) of its direction, world frame.
        begin: Where to begin, in lengths of the direction.
        end: Where something else is hit.

    Returns:
        The length, inf if it exceeds `end`; the normal (x, y, z), not of unit length; the stone, -1 for none; the fine
        relief's height [m]; the share of bare bedrock; and the height over the ground between the stones [m], and the
        slopes of that ground.
    """
    cover = relief.cover
    rx, ry, rz = ray
    across = math.sqrt(rx * rx + ry * ry)
    t = begin
    x, y, z = origin[0] + t * rx, origin[1] + t * ry, origin[2] + t * rz
    footprint = footprint_at(eye, focal, x, y, z)
    open_ground, packed = _most_stones(data, cover, x, y)
    highest = _tallest(octave, open_ground, packed, footprint)
    wave = 0.25 * max(np.float32(0.035), np.float32(4) * footprint) / max(across, 1e-9)
    steep = steepest * shown_at(SHORT_WAVE, footprint, np.float32(NONE), np.float32(WHOLE))
    begun, piece = t, max(PIECE, np.float32(2) * footprint)
    x0, y0 = x, y
    model = around(data, relief, np.float32(x), np.float32(y), footprint)
    height, east, north, level_e, level_n = near_height(data, model, np.float32(0), np.float32(0))
    gap = z - height
    high_begun = gap
    far = -float(relief.base.coarse_start)
    none, zero = -1, np.float32(0)
    for _ in range(STEPS):
        if t > end or abs(x) > far or abs(y) > far:
            break
        if gap <= NEAR * t:
            return _on_ground(data, relief, eye, focal, origin, ray, t)
        closing = east * rx + north * ry - rz
        step = min(gap / closing, wave) if closing > 0 else wave
        step = max(step, gap / max(level_e * rx + level_n * ry + across * steep - rz, 0.02))
        t2 = t + step
        x2, y2, z2 = origin[0] + t2 * rx, origin[1] + t2 * ry, origin[2] + t2 * rz
        if abs(x2 - x0) + abs(y2 - y0) > AROUND:
            x0, y0 = x2, y2
            footprint = footprint_at(eye, focal, x2, y2, z2)
            model = around(data, relief, np.float32(x2), np.float32(y2), footprint)
        height, east2, north2, level_e, level_n = near_height(data, model, np.float32(x2 - x0), np.float32(y2 - y0))
        gap2 = z2 - height
        if gap2 < -NEAR * t2:
            # crossed: close in on the root between t and t2
            low, high, gap_low, gap_high = t, t2, gap, gap2
            for _ in range(12):
                t2 = low + (high - low) * min(max(gap_low / (gap_low - gap_high), 0.02), 0.98)
                x2, y2, z2 = origin[0] + t2 * rx, origin[1] + t2 * ry, origin[2] + t2 * rz
                height, east2, north2, _, _ = near_height(data, model, np.float32(x2 - x0), np.float32(y2 - y0))
                gap2 = z2 - height
                if abs(gap2) < NEAR * t2:
                    break
                if gap2 > 0:
                    low, gap_low = t2, gap2
                else:
                    high, gap_high = t2, gap2
        length = t2 - begun
        if highest > 0 and (length * across > piece or gap2 <= NEAR * t2):
            if length > 0 and min(high_begun, gap2) < highest:
                where, who, by, lift, sx, sy = _stone_hit(
                    data, cover, start, member, stone, planes, octave, eye, focal, footprint, open_ground, packed,
                    origin[0] + begun * rx, origin[1] + begun * ry, origin[2] + begun * rz, high_begun,
                    rx, ry, (gap2 - high_begun) / length, length,
                )  # fmt: skip
                if who >= 0:
                    crossing = _on_stone(
                        data, relief, stone, planes, eye, focal, origin, ray, begun + where, end, who, by, lift, sx, sy
                    )
                    if crossing[2] >= 0:
                        return crossing
            begun, high_begun = t2, gap2
        t, x, y, z, gap = t2, x2, y2, z2, gap2
        east, north = east2, north2
    return np.inf, (0.0, 0.0, 1.0), none, zero, zero, 0.0, zero, zero


@inlined
def _on_ground(data, relief, eye, focal, origin, ray, t):
    """Return the crossing of a ray with the ground, of which t is nearly the length, as first_crossing does."""
    rx, ry, rz = ray
    east, north, fine, bare = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for _ in range(6):
        x, y, z = origin[0] + t * rx, origin[1] + t * ry, origin[2] + t * rz
        height, east, north, _, _, fine, bare = height_at(
            data, relief, np.float32(x), np.float32(y), footprint_at(eye, focal, x, y, z), True
        )
        gap = z - height
        t += gap / max(east * rx + north * ry - rz, 0.05)
        if abs(gap) < EXACT * t:
            break
    normal = (-float(east), -float(north), 1.0)
    return t, normal, -1, fine, bare, 0.0, east, north


@inlined
def _on_stone(data, relief, stone, planes, eye, focal, origin, ray, t, end, who, by, lift, sx, sy):
    """Return the crossing of a ray with a stone, of which t is nearly the length, as first_crossing does.

    The stone is -1 if the ray does not meet it. who, by, lift, sx, sy: of _stone_hit.
    """
    rx, ry, rz = ray
    gu, gv, gw = np.float32(0), np.float32(0), np.float32(1)
    gap, east, north, fine, bare = 0.0, np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    met = False
    for _ in range(5):
        x, y, z = origin[0] + t * rx, origin[1] + t * ry, origin[2] + t * rz
        height, east, north, _, _, fine, bare = height_at(
            data, relief, np.float32(x), np.float32(y), footprint_at(eye, focal, x, y, z), True
        )
        gap = z - height
        east_of, north_of = np.float32(x - sx), np.float32(y - sy)
        value, gu, gv, gw = _stone_side(stone, planes, who, by, lift, east_of, north_of, np.float32(gap))
        growth = gu * rx + gv * ry + gw * (rz - east * rx - north * ry)
        if growth >= 0:
            break  # the ground is not so level here that the ray meets this stone
        move = min(max(-value / growth, -0.01), 0.01)
        t += move
        if abs(move) < SKIM * t:
            met = t < end
            break
    normal = (float(gu - gw * east), float(gv - gw * north), float(gw))
    return t, normal, who if met else -1, fine, bare, gap, east, north


@inlined
def _sun_share(
    data, relief, start, member, stone, planes, octave, steepest, eye, focal, x, y, z, gap, east, north, sun
):  # fmt: skip
    """Return the share of the sun's disc that relief and stones leave free over a point, 0 to 1, float32.

    x, y, z: the point, a little off its surface; gap: its height over the ground between the stones; east, north:
    slopes of that ground; sun: unit vector towards the sun. Hills and rocks are not looked at.
    """
    growth = sun[2] - east * sun[0] - north * sun[1]
    if growth <= 0.02:
        return np.float32(1)
    footprint = footprint_at(eye, focal, x, y, z)
    open_ground, packed = _most_stones(data, relief.cover, x, y)
    top = _tallest(octave, open_ground, packed, footprint)
    if gap < top:
        length = min((top - gap) / growth, LONGEST_SHADOW)
        _, who, _, _, _, _ = _stone_hit(
            data, relief.cover, start, member, stone, planes, octave, eye, focal, footprint, open_ground, packed,
            x, y, z, gap, sun[0], sun[1], growth, length,
        )  # fmt: skip
        if who >= 0:
            return np.float32(0)
    free = np.float32(1)
    level = math.sqrt(sun[0] * sun[0] + sun[1] * sun[1])
    if sun[2] < level * (2.5 * steepest + 0.1):
        reach = max(0.012, 1.5 * footprint) / level
        model = around(data, relief, np.float32(x), np.float32(y), footprint)
        for _ in range(SHADOW_STEPS):
            height, _, _, _, _ = near_height(data, model, np.float32(reach * sun[0]), np.float32(reach * sun[1]))
            blur = SUN_RADIUS * reach + 0.1 * footprint
            free = min(free, np.float32(min(max(0.5 + 0.5 * (z + reach * sun[2] - height) / blur, 0.0), 1.0)))
            reach *= 2.2
    return free


@inlined
def _facing(normal, ray):
    """Return the unit vector along a normal (x, y, z), turned a little where it does not face the camera of a ray."""
    nx, ny, nz = normal
    unit = 1 / math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx * unit, ny * unit, nz * unit
    away = (nx * ray[0] + ny * ray[1] + nz * ray[2]) / (ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
    if away > -EDGE_ON:  # a crest is hit edge-on
        nx, ny, nz = nx - (away + EDGE_ON) * ray[0], ny - (away + EDGE_ON) * ray[1], nz - (away + EDGE_ON) * ray[2]
        unit = 1 / math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * unit, ny * unit, nz * unit
    return nx, ny, nz


@compiled
def crossings(ground, eye, focal, pose, rays, begin, end, sun):
    """Return what rays meet on the ground, see first_crossing.

    Args:
        ground: Ground.
        eye: (3,) position of the left camera [m].
        focal: Its focal length [px].
        pose: (4, 4) camera to world.
        rays: (N, 3) directions, camera frame, z = 1.
        begin: (N,) depths at which to begin; inf for rays that do not come near the ground.
        end: (N,) depths at which something else is hit.
        sun: (3,) unit vector towards the sun, world frame; a zero vector if the light does not matter.

    Returns:
        Depths (N,) [m], inf where the ground is not met; unit normals (N, 3), world frame; and details (N, 4) of
        gbuffer.Hits.
    """
    data, relief, stones, steepest = ground
    start, member, bodies, planes, octave = stones
    n = len(rays)
    depth = np.full(n, np.inf)
    normal = np.zeros((n, 3), dtype=np.float32)
    detail = np.zeros((n, 4), dtype=np.float32)
    origin = (pose[0, 3], pose[1, 3], pose[2, 3])
    light = (sun[0], sun[1], sun[2])
    shine = light[2] > 0
    for k in range(n):
        detail[k, 0], detail[k, 3] = -1, 1
        if not begin[k] < end[k]:
            continue
        u, v = rays[k, 0], rays[k, 1]
        ray = (
            pose[0, 0] * u + pose[0, 1] * v + pose[0, 2],
            pose[1, 0] * u + pose[1, 1] * v + pose[1, 2],
            pose[2, 0] * u + pose[2, 1] * v + pose[2, 2],
        )
        t, bent, who, fine, bare, gap, east, north = first_crossing(
            data, relief, start, member, bodies, planes, octave, steepest, eye, focal, origin, ray, begin[k], end[k]
        )
        if t == np.inf:
            continue
        nx, ny, nz = _facing(bent, ray)
        depth[k] = t
        normal[k, 0], normal[k, 1], normal[k, 2] = nx, ny, nz
        detail[k, 0], detail[k, 1], detail[k, 2] = who, fine, bare
        if shine and nx * light[0] + ny * light[1] + nz * light[2] > 0:
            x, y = origin[0] + t * ray[0] + OFF * nx, origin[1] + t * ray[1] + OFF * ny
            z = origin[2] + t * ray[2] + OFF * nz
            gap += OFF * (nz - nx * east - ny * north)
            detail[k, 3] = _sun_share(
                data, relief, start, member, bodies, planes, octave, steepest, eye, focal,
                x, y, z, gap, east, north, light,
            )  # fmt: skip
    return depth, normal, detail
