"""Compiled vector parts of an implicit Euler step, each one pass over memory."""

import numpy as np

from cusick_bench.sim.laws.vectors import kernel


@kernel()
def right_hand_side(free, mass, h, v, force, out):
    """out = M v + h F at the free vertices.

    Args:
        free: Indices of the free vertices.
        mass: (members, vertices) [kg].
        h: Step [s].
        v: Velocities (members, vertices, 3) [m/s].
        force: (members, vertices, 3) [N].
        out: Receives (members, rows, 3) [kg m/s].

    Returns:
        Which members have finite forces (members).
    """
    good = np.ones(len(out), np.bool_)
    for member in range(len(out)):
        for row in range(len(free)):
            i = free[row]
            for axis in range(3):
                value = mass[member, i] * v[member, i, axis] + h * force[member, i, axis]
                out[member, row, axis] = value
                if not np.isfinite(value):
                    good[member] = False
    return good


@kernel()
def move(free, h, solution, x, v_new, x_new):
    """v_new = solution at the free vertices, x_new = x + h v_new.

    Args:
        free: Indices of the free vertices.
        h: Step [s].
        solution: Their new velocities (members, rows, 3) [m/s].
        x: Positions (members, vertices, 3) [m].
        v_new: Receives new velocities; those of fixed vertices stay as they are, zero.
        x_new: Receives new positions.

    Returns:
        Largest coordinate of each member (members) [m].
    """
    far = np.zeros(len(x))
    for member in range(len(x)):
        x_new[member] = x[member]
        for row in range(len(free)):
            i = free[row]
            for axis in range(3):
                v_new[member, i, axis] = solution[member, row, axis]
                x_new[member, i, axis] = x[member, i, axis] + h * solution[member, row, axis]
                far[member] = max(far[member], abs(x_new[member, i, axis]))
    return far
