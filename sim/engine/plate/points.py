"""Compiled geometry of one quadrature point of a shell, for the kernels of law `plate`.

Everything there depends on the derivatives of position by the material coordinates, y = (x_,1, x_,2, x_,11, x_,22,
2 x_,12). With n = x_,1 x x_,2 / J, J = |x_,1 x x_,2|, curvatures are kappa_k = n . s_k, s = (x_,11, x_,22, 2 x_,12):

    d kappa_k / d s_k = n,   d kappa_k / d x_,1 = x_,2 x c_k = a_k n,   d kappa_k / d x_,2 = c_k x x_,1 = b_k n,
    c_k = (s_k - kappa_k n) / J.

References:
    Cirak, Ortiz, Schroeder. Subdivision surfaces: a new paradigm for thin-shell finite-element analysis. Int. J.
    Numerical Methods in Engineering 47, 2000: energy of the shell, Section 2.
"""

import math

from cusick_bench.sim.laws.vectors import combine, cross, dot, kernel


@kernel()
def position_slopes(first, end, nodes, weight, base, field):
    """x_,1 and x_,2 at a point.

    Args:
        first, end: Places of the point's nodes.
        nodes: Control point at every place.
        weight: Rows of the derivatives at every place (places, 5).
        base: x_,1 and x_,2 of the undeformed cloth (2, 3).
        field: Displacements (rows, 3) [m].

    Returns:
        Two vectors.
    """
    a, b, c, d, e, f = base[0, 0], base[0, 1], base[0, 2], base[1, 0], base[1, 1], base[1, 2]
    for at in range(first, end):
        node, u, v = nodes[at], weight[at, 0], weight[at, 1]
        x, y, z = field[node, 0], field[node, 1], field[node, 2]
        a, b, c, d, e, f = a + u * x, b + u * y, c + u * z, d + v * x, e + v * y, f + v * z
    return (a, b, c), (d, e, f)


@kernel()
def second_slopes(first, end, nodes, weight, field):
    """x_,11, x_,22 and 2 x_,12 at a point; arguments as in `position_slopes`."""
    a, b, c, d, e, f, g, h, i = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for at in range(first, end):
        node, u, v, w = nodes[at], weight[at, 2], weight[at, 3], weight[at, 4]
        x, y, z = field[node, 0], field[node, 1], field[node, 2]
        a, b, c = a + u * x, b + u * y, c + u * z
        d, e, f = d + v * x, e + v * y, f + v * z
        g, h, i = g + w * x, h + w * y, i + w * z
    return (a, b, c), (d, e, f), (g, h, i)


@kernel()
def normal(xu, xv):
    """Unit normal n, and J = |x_,1 x x_,2|."""
    a = cross(xu, xv)
    length = math.sqrt(dot(a, a))
    return (a[0] / length, a[1] / length, a[2] / length), length


@kernel()
def curvature(s, n, length):
    """kappa = n . s and c of one curvature."""
    value = dot(n, s)
    return value, combine(1.0 / length, s, -value / length, n)


@kernel()
def bending_slopes(c, xu, xv, n):
    """a and b of one curvature: its derivatives to x_,1 and x_,2 are a n and b n."""
    return dot(n, cross(xv, c)), dot(n, cross(c, xu))


@kernel()
def member_table(tables, at):
    """The table of a member or of a point; one alone is everybody's."""
    return tables[at if tables.shape[0] > 1 else 0]
