"""Where rays first meet the ground: its height field, and the stones on it.

A ray enters near the ground where it passes a mesh that lies above the relief everywhere. A ray of an image begins
later, above the place where the ray below it ended: it runs higher, nearly in the same vertical plane, and neither
ground nor stones have overhangs. In less than one of 1000 rays the depth differs by a thousandth or more from that of
the ray alone. From there it advances to the first crossing. A step is as long as the steepest slope allows, or
a fraction of the shortest wave in view; the last ones are Newton's. Stones are tested piece by piece, in the ray's
height over the ground, which is nearly linear over a piece.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled_in_place, inlined
from marssim.render.relief.height import around, footprint_at, height_at, near_height, shown_at
from marssim.render.relief.stones.hits import Piece, most_stones, stone_hit, stone_side, tallest
from marssim.render.relief.sunlight import sun_share
from marssim.render.relief.tiles import NONE, WHOLE

STEPS = 200  # steps after which a ray that still skims the ground is given up
EDGE_ON = 1e-3  # least cosine between a normal and the direction towards the camera
OFF = 2e-4  # [m] distance from a surface at which rays to the sun start
SHORT_WAVE = np.float32(0.1)  # [m] wave whose visibility stands for that of all fine relief
PIECE = np.float32(0.025)  # [m] length on the ground of the pieces of a ray that are tested for stones
AROUND = 0.08  # [m] how far from the middle of a model of the relief it is used
NEAR = 2e-4  # height over the ground, over the ray's length, from which the last step of a ray leads to it
EXACT = 1e-4  # the same of the exact relief, from which a step of Newton's gives the crossing
MET = 1e-3  # the same after the last of these steps, from which on the ray did not meet the ground there
LEAP = 0.02  # longest of these steps, over the ray's length
LONGEST = 1.0  # [m] longest step over ground, a cell of the far grid: behind it a hill may rise
DOUBTS = 6  # times that a ray goes on where it did not
BESIDE = 4.0  # [px] how far before that place a ray of an image begins, for what lies between two columns
LEANING = 2.0  # columns per row by which a vertical plane may lean in an image whose rays begin there
WIDE = np.float32(0.03)  # [m] width of a pixel from which on they do not: steps are as long as from row to row there
PLANE = 2e-4  # length of a step, over the ray's, on which the ground counts as a plane
SKIM = 2e-5  # length of a step, over the ray's, after which a crossing with a stone is found


@inlined
def first_crossing(data, relief, stones, steepest, eye, focal, origin, ray, begin, later, end):
    """Follow a ray from `begin` to its first crossing with the ground.

    Args:
        data: Of Ground.
        relief: Of Ground.
        stones: Of Ground.
        steepest: Slope that the relief hardly exceeds.
        eye: Position of the left camera [m].
        focal: Its focal length [px].
        origin: (x, y, z) of the ray's start [m], world frame.
        ray: (x, y, z) of its direction, world frame.
        begin: Where to begin, in lengths of the direction.
        later: Where to begin if the ray is above the ground there and pixels are narrow.
        end: Where something else is hit.

    Returns:
        The length, inf if it exceeds `end`; the normal (x, y, z), not of unit length; the stone, -1 for none; the fine
        relief's height [m]; the share of bare bedrock; and the height over the ground between the stones [m], and the
        slopes of that ground.
    """
    cover, octave = relief.cover, stones.octave
    rx, ry, rz = ray
    across = math.sqrt(rx * rx + ry * ry)
    t, x, y, z, x0, y0 = later, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(2):
        x, y, z = origin[0] + t * rx, origin[1] + t * ry, origin[2] + t * rz
        x0, y0 = x, y
        footprint = footprint_at(eye, focal, x, y, z)
        model = around(data, relief, np.float32(x), np.float32(y), footprint)
        height, east, north, level_e, level_n = near_height(data, model, np.float32(0), np.float32(0))
        gap = z - height
        if t == begin or (gap > NEAR * t and footprint < WIDE):
            break
        t = begin
    ranks = most_stones(data, cover, x, y)
    highest = tallest(octave, ranks, footprint)
    wave = 0.25 * max(np.float32(0.035), np.float32(4) * footprint) / max(across, 1e-9)
    steep = steepest * shown_at(SHORT_WAVE, footprint, np.float32(NONE), np.float32(WHOLE))
    begun, piece = t, max(PIECE, np.float32(2) * footprint)
    high_begun = gap
    far = -float(relief.base.coarse_start)
    leap = LONGEST / max(across, 1e-9)
    none, zero, longest, doubts = -1, np.float32(0), np.inf, 0
    for _ in range(STEPS):
        if t > end or abs(x) > far or abs(y) > far:
            break
        if gap <= NEAR * t:
            met, crossing = _on_ground(data, relief, eye, focal, origin, ray, t)
            if met or doubts == DOUBTS or footprint > AROUND:
                return crossing
            doubts, x0 = doubts + 1, np.inf  # at a brink the model may lie too high: look again with one of this place
        closing = east * rx + north * ry - rz
        step = min(gap / closing, wave) if closing > 0 else wave
        step = max(step, gap / max(level_e * rx + level_n * ry + across * steep - rz, 0.02))
        t2 = t if x0 == np.inf else t + min(step, longest, leap)
        x2, y2, z2 = origin[0] + t2 * rx, origin[1] + t2 * ry, origin[2] + t2 * rz
        if abs(x2 - x0) + abs(y2 - y0) > AROUND:
            x0, y0 = x2, y2
            footprint = footprint_at(eye, focal, x2, y2, z2)
            model = around(data, relief, np.float32(x2), np.float32(y2), footprint)
            ranks = most_stones(data, cover, x2, y2)
            highest = tallest(octave, ranks, footprint)
        height, east2, north2, level_e2, level_n2 = near_height(data, model, np.float32(x2 - x0), np.float32(y2 - y0))
        gap2 = z2 - height
        if gap2 < -NEAR * t2 and (t2 - t) * across > AROUND > footprint:
            longest = 0.9 * AROUND / across  # behind a brink, where the terrain fell away from its slope
            continue
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
        if highest > 0 and (length * across > piece or gap2 <= NEAR * t2 or t2 > end):
            if length > 0 and min(high_begun, gap2) < highest:
                at = origin[0] + begun * rx, origin[1] + begun * ry, origin[2] + begun * rz
                part = Piece(at[0], at[1], at[2], high_begun, rx, ry, (gap2 - high_begun) / length, length)
                hit = stone_hit(data, cover, stones, eye, focal, footprint, ranks, part)
                if hit.stone >= 0:
                    crossing = _on_stone(data, relief, stones, eye, focal, origin, ray, begun + hit.where, end, hit)
                    if crossing[2] >= 0:
                        return crossing
            begun, high_begun = t2, gap2
        t, x, y, z, gap = t2, x2, y2, z2, gap2
        east, north, level_e, level_n = east2, north2, level_e2, level_n2
    return np.inf, (0.0, 0.0, 1.0), none, zero, zero, 0.0, zero, zero


@inlined
def _on_ground(data, relief, eye, focal, origin, ray, t):
    """Return whether a ray meets the ground where its length is nearly t, and the crossing, as first_crossing does."""
    rx, ry, rz = ray
    gap = 0.0
    east, north, fine, bare = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for _ in range(10):
        x, y, z = origin[0] + t * rx, origin[1] + t * ry, origin[2] + t * rz
        height, east, north, _, _, fine, bare = height_at(
            data, relief, np.float32(x), np.float32(y), footprint_at(eye, focal, x, y, z), True
        )
        gap = z - height
        t += min(max(gap / max(east * rx + north * ry - rz, 0.05), -LEAP * t), LEAP * t)
        if abs(gap) < EXACT * t:
            break
    normal = (-float(east), -float(north), 1.0)
    return abs(gap) < MET * t, (t, normal, np.int32(-1), fine, bare, 0.0, east, north)


@inlined
def _on_stone(data, relief, stones, eye, focal, origin, ray, t, end, hit):
    """Return the crossing of a ray with the stone of a StoneHit, at a length of nearly t, as first_crossing does.

    The stone is -1 if the ray does not meet it.
    """
    rx, ry, rz = ray
    gu, gv, gw = np.float32(0), np.float32(0), np.float32(1)
    gap, east, north, fine, bare = 0.0, np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    met, move = False, np.inf
    for _ in range(5):
        x, y, z = origin[0] + t * rx, origin[1] + t * ry, origin[2] + t * rz
        if abs(move) > PLANE * t:
            height, east, north, _, _, fine, bare = height_at(
                data, relief, np.float32(x), np.float32(y), footprint_at(eye, focal, x, y, z), True
            )
            gap = z - height
        else:
            gap += move * (rz - east * rx - north * ry)
        place = np.float32(x - hit.x), np.float32(y - hit.y), np.float32(gap)
        value, gu, gv, gw = stone_side(stones, hit, place)
        growth = gu * rx + gv * ry + gw * (rz - east * rx - north * ry)
        if growth >= 0:
            break  # the ground is not so level here that the ray meets this stone
        move = min(max(-value / growth, -0.01), 0.01)
        t += move
        if abs(move) < SKIM * t:
            met = t < end
            break
    normal = (float(gu - gw * east), float(gv - gw * north), float(gw))
    return t, normal, hit.stone if met else -1, fine, bare, gap, east, north


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


def crossings(
    ground: tuple, eye: np.ndarray, focal: float, pose: np.ndarray, rays: np.ndarray, begin: np.ndarray,
    end: np.ndarray, sun: np.ndarray, width: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return what rays meet on the ground, see first_crossing.

    Args:
        ground: The first four of Ground.
        eye: (3,) position of the left camera [m].
        focal: Its focal length [px].
        pose: (4, 4) camera to world.
        rays: (N, 3) directions, camera frame, z = 1.
        begin: (N,) depths at which to begin; inf for rays that do not come near the ground.
        end: (N,) depths at which something else is hit.
        sun: (3,) unit vector towards the sun, world frame; a zero vector if the light does not matter.
        width: Pixels in a row if the rays are all those of an image, row by row; 0 if not.

    Returns:
        Depths (N,) [m], inf where the ground is not met; unit normals (N, 3), world frame; and details (N, 4) of
        gbuffer.Hits.
    """
    n = len(rays)
    out = np.full(n, np.inf), np.zeros((n, 3), dtype=np.float32), np.zeros((n, 4), dtype=np.float32)
    _cross(ground, eye, focal, pose, rays, begin, end, sun, width, np.zeros(n if width else 0), *out)
    return out


@compiled_in_place
def _cross(ground, eye, focal, pose, rays, begin, end, sun, width, clear, depth, normal, detail):
    """Write what rays meet. clear: (N,) how far over the ground each ray of an image is free [m], to be filled in."""
    data, relief, stones, steepest = ground
    origin = (pose[0, 3], pose[1, 3], pose[2, 3])
    light = (sun[0], sun[1], sun[2])
    shine = light[2] > 0
    for k in range(len(rays) - 1, -1, -1):  # from the lowest row up
        detail[k, 0], detail[k, 3] = -1, 1
        u, v = rays[k, 0], rays[k, 1]
        ray = (
            pose[0, 0] * u + pose[0, 1] * v + pose[0, 2],
            pose[1, 0] * u + pose[1, 1] * v + pose[1, 2],
            pose[2, 0] * u + pose[2, 1] * v + pose[2, 2],
        )
        level = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1])
        if not begin[k] < end[k]:
            if width > 0 and end[k] < np.inf:
                clear[k] = end[k] * level
            continue
        later = begin[k]
        if width > 0:
            later = max(later, (1 - BESIDE / focal) * _clear_below(pose, rays, width, k, clear) / max(level, 1e-9))
            clear[k] = level * (end[k] if end[k] < np.inf else begin[k])
        t, bent, who, fine, bare, gap, east, north = first_crossing(
            data, relief, stones, steepest, eye, focal, origin, ray, begin[k], later, end[k]
        )
        if t == np.inf:
            continue
        if width > 0:
            clear[k] = t * level
        nx, ny, nz = _facing(bent, ray)
        depth[k] = t
        normal[k, 0], normal[k, 1], normal[k, 2] = nx, ny, nz
        detail[k, 0], detail[k, 1], detail[k, 2] = who, fine, bare
        if shine and nx * light[0] + ny * light[1] + nz * light[2] > 0:
            x, y = origin[0] + t * ray[0] + OFF * nx, origin[1] + t * ray[1] + OFF * ny
            z = origin[2] + t * ray[2] + OFF * nz
            gap += OFF * (nz - nx * east - ny * north)
            detail[k, 3] = sun_share(
                data, relief, stones, steepest, eye, focal,
                x, y, z, gap, east, north, light,
            )  # fmt: skip


@inlined
def _clear_below(pose, rays, width, k, clear):
    """Return how far over the ground the rays are free between which the vertical plane of ray k passes a row below.

    clear: of _cross. 0 if that is not known.
    """
    u, v = rays[k, 0], rays[k, 1]
    below = k + width
    sinks = pose[2, 2] * v - pose[2, 1]  # how an image point moves that sinks: down, and right
    if below >= len(rays) or sinks <= 0:
        return 0.0
    leaning = (pose[2, 2] * u - pose[2, 0]) / sinks * (rays[below, 1] - v) / (rays[1, 0] - rays[0, 0])
    left = np.int64(math.floor(min(max(leaning, -LEANING), LEANING)))
    if k % width + left < 0 or k % width + left + 1 >= width or abs(leaning) >= LEANING:
        return 0.0
    return min(clear[below + left], clear[below + left + 1])
