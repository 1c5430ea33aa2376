"""The motion at which six wheels on soil balance the weight that pulls a rover downhill, and their own resistance.

A wheel slides over the ground with the velocity v = u - w: its rim moves with u as the motor turns it, its hub with w.
The soil pulls it along v with the force H(|v| / |u|), which is the drawbar pull at that slip less that at no slip, and
holds it back along -u with the resistance at no slip. So a wheel that drives straight has the drawbar pull of its
table. That the shear stress opposes the sliding velocity, sideways as forwards, is the model of Wong and Chiang (2001)
for tracks. Across u, the force is greater by a factor, since there the shear stress does not dig the wheel in. The soil
that the side of a wheel pushes is left out. A wheel that drives downhill slides forwards by as much as one that thrusts
as hard slides back.
"""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled

ITERATIONS = 200  # most iterations
TOLERANCE = 1e-7  # [m/s] change of the motion that ends them
SLOWEST = 0.1  # speed of a rim, over that of the fastest one, below which it counts as this fast
CREEP = 0.02  # [m/s] likewise for all rims together, so that a braked wheel nearly holds
FIRM = 1e-3  # slip below which the secant of the pull is that at this slip


@compiled
def balanced_motion(hubs, rims, pull, side, resistance, push, inertia, start):
    """Return the motion of the rover, the slip of each wheel, and the force of the soil on each wheel.

    Without inertia, the motion is the quasi-static one. Where the weight exceeds what the soil holds, the rover slides.
    Each iteration replaces the soil by dampers with the secant of H, which converges since H bends downwards.

    Args:
        hubs: (N, 2) places of the wheels in the body frame [m].
        rims: (N, 2) velocities of the rims, forwards where the wheel drives forwards, in the body frame [m/s].
        pull: (N, S) H of the wheels [N] at the slips (i / (S - 1)) ** 2; 0 at the first.
        side: (N,) factor of H across the rims' velocities, above 0. It is 1 for wheels that do not turn.
        resistance: (N,) force along -u [N].
        push: (3,) other forces in the body's plane [N], and their moment about its z [N m].
        inertia: (3,) mass over time step [kg/s], twice, and moment of inertia over time step [kg m2/s]; 0 without.
        start: (3,) motion at the start: velocity in the body frame [m/s] and yaw rate [rad/s].

    Returns:
        The motion (3,), the slips |v| / |u| (N,), and the forces (N, 2) in the body frame [N].
    """
    count, steps = pull.shape[0], pull.shape[1] - 1
    speed = np.sqrt(rims[:, 0] ** 2 + rims[:, 1] ** 2)
    least = max(SLOWEST * speed.max(), CREEP)
    motion, slip, force = start.copy(), np.zeros(count), np.zeros((count, 2))
    for _ in range(ITERATIONS):
        matrix, right = np.zeros((3, 3)), push + inertia * start
        for k in range(3):
            matrix[k, k] = inertia[k] + 1e-9
        for n in range(count):
            x, y = hubs[n, 0], hubs[n, 1]
            slide_x = rims[n, 0] - motion[0] + motion[2] * y
            slide_y = rims[n, 1] - motion[1] - motion[2] * x
            fast = max(speed[n], least)
            slip[n] = np.sqrt(slide_x**2 + slide_y**2) / fast
            some = min(max(slip[n], FIRM), 1.0)
            place = np.sqrt(some) * steps
            low = min(int(place), steps - 1)
            # between the nodes the table is linear in the slip
            before, after = (low / steps) ** 2, ((low + 1) / steps) ** 2
            value = pull[n, low] + (pull[n, low + 1] - pull[n, low]) * (some - before) / (after - before)
            damping = value / (some * fast)  # beyond a slip of 1, the pull grows in proportion
            along_x, along_y, hold, across = 0.0, 0.0, 0.0, 0.0
            if speed[n] > 1e-9:
                along_x, along_y, hold = rims[n, 0] / speed[n], rims[n, 1] / speed[n], resistance[n]
                across = damping * (side[n] - 1)
            # the damper as a symmetric matrix: more of it across the rim's velocity
            xx, yy = damping + across * along_y**2, damping + across * along_x**2
            xy = -across * along_x * along_y
            force[n, 0] = xx * slide_x + xy * slide_y - hold * along_x
            force[n, 1] = xy * slide_x + yy * slide_y - hold * along_y
            first = xx * rims[n, 0] + xy * rims[n, 1] - hold * along_x
            second = xy * rims[n, 0] + yy * rims[n, 1] - hold * along_y
            right[0] += first
            right[1] += second
            right[2] += x * second - y * first
            matrix[0, 0] += xx
            matrix[0, 1] += xy
            matrix[1, 1] += yy
            matrix[0, 2] += xy * x - xx * y
            matrix[1, 2] += yy * x - xy * y
            matrix[2, 2] += yy * x * x - 2 * xy * x * y + xx * y * y
        matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
        following = np.linalg.solve(matrix, right)
        change = np.abs(following - motion).max()
        motion = following
        if change < TOLERANCE:
            break
    return motion, slip, force
