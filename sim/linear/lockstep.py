"""Multifrontal factorisation of the matrices of a batch in lockstep, a vector register's lane for each.

The fronts and their order are those of `multifrontal`, but each operation is done for LANES matrices at once (a pack),
on tiles as `lanes` has them. A matrix so has the same factor, to the bit, in any batch and in any place of it; it is
that of `multifrontal` to rounding. Single matrices are left to `multifrontal`.

A front's panel is a strip for each of its rows of tiles: own rows as far as the diagonal, boundary rows whole. Its
update is the lower triangle's tiles, row after row.
"""

from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.linear import lanes
from cusick_bench.sim.linear.elimination import EliminationTree, stack_updates
from cusick_bench.sim.linear.interface import BLOCK, Factor
from cusick_bench.sim.linear.lanes import LANES, TILE, VECTOR
from cusick_bench.sim.linear.multifrontal import MultifrontalSolver

_TILE_VECTORS = BLOCK * BLOCK


class TileTree(NamedTuple):
    """An elimination tree in tiles; see `EliminationTree` for what is not here.

    Attributes:
        order, start, boundary_start, boundary, child_start, children, slot_start, slots: As there.
        own: Vertices that each front eliminates.
        beyond: Vertices on its boundary.
        above: Row of tiles, in the parent's front, of every boundary vertex.
        targets: Row and column of tiles where each slot goes, in the front that has it.
        panel_start: First tile of each front's panel, and the end.
        update_start: First tile of each front's update.
        update_end: Tiles of the workspace of updates.
        schedule_start, schedule: As there.
    """

    order: Int[ndarray, " vertices"]
    start: Int[ndarray, " fronts_and_end"]
    boundary_start: Int[ndarray, " fronts_and_end"]
    boundary: Int[ndarray, " entries"]
    child_start: Int[ndarray, " fronts_and_end"]
    children: Int[ndarray, " others"]
    slot_start: Int[ndarray, " fronts_and_end"]
    slots: Int[ndarray, " needed"]
    own: Int[ndarray, " fronts"]
    beyond: Int[ndarray, " fronts"]
    above: Int[ndarray, " entries"]
    targets: Int[ndarray, "needed 2"]
    panel_start: Int[ndarray, " fronts_and_end"]
    update_start: Int[ndarray, " fronts"]
    update_end: int
    schedule_start: Int[ndarray, " parts_and_end"]
    schedule: Int[ndarray, " fronts"]


def tile_tree(tree: EliminationTree) -> TileTree:
    """Places of the tiles.

    Args:
        tree: The analysis in numbers.

    Returns:
        The same in tiles.
    """
    own, beyond = tree.sizes.T // BLOCK
    fronts = range(len(own))
    parent = np.full(len(own), -1)
    children = [tree.children[tree.child_start[front] : tree.child_start[front + 1]].tolist() for front in fronts]
    for front, group in enumerate(children):
        parent[group] = front
    above = np.zeros(len(tree.boundary), np.int64)
    targets = np.empty((len(tree.slots), 2), np.int64)
    for front in fronts:
        for first, end, row in tree.runs[tree.run_start[front] : tree.run_start[front + 1]] // BLOCK:
            above[tree.boundary_start[front] + np.arange(first, end)] = row + np.arange(end - first)
        entries = slice(tree.slot_start[front], tree.slot_start[front + 1])
        places = (tree.targets[entries] - tree.panel_start[front]) // BLOCK
        column, targets[entries, 0] = np.divmod(places, BLOCK * (own[front] + beyond[front]))
        targets[entries, 1] = column
    parts = [tree.schedule[begin:end].tolist() for begin, end in pairwise(tree.schedule_start)]
    update_start, update_end = stack_updates(parts, parent, children, beyond * (beyond + 1) // 2)
    return TileTree(
        order=tree.order,
        start=tree.start,
        boundary_start=tree.boundary_start,
        boundary=tree.boundary,
        child_start=tree.child_start,
        children=tree.children,
        slot_start=tree.slot_start,
        slots=tree.slots,
        own=own,
        beyond=beyond,
        above=above,
        targets=targets,
        panel_start=np.concatenate([[0], np.cumsum(own * (own + 1) // 2 + own * beyond)]),
        update_start=update_start,
        update_end=update_end,
        schedule_start=tree.schedule_start,
        schedule=tree.schedule,
    )


@numba.njit(cache=True)
def _strip(own, row):
    """Tiles of a panel before a row's strip."""
    return row * (row + 1) // 2 if row <= own else own * (own + 1) // 2 + (row - own) * own


@numba.njit(cache=True)
def _triangle(row, column):
    """Tiles of an update before one of its tiles."""
    return row * (row + 1) // 2 + column


@numba.njit(cache=True)
def _gather_matrices(front, tree, blocks, first, panel):
    """Put the matrices' blocks into a front's panel; beyond the last matrix, lanes repeat it."""
    base, own = _TILE_VECTORS * tree.panel_start[front], tree.own[front]
    panel[LANES * base : LANES * _TILE_VECTORS * tree.panel_start[front + 1]] = 0.0
    for entry in range(tree.slot_start[front], tree.slot_start[front + 1]):
        slot = tree.slots[entry]
        tile = LANES * (base + _TILE_VECTORS * (_strip(own, tree.targets[entry, 0]) + tree.targets[entry, 1]))
        for lane in range(LANES):
            block = blocks[min(first + lane, blocks.shape[0] - 1), slot]
            for column in range(BLOCK):
                for row in range(BLOCK):
                    panel[tile + LANES * (BLOCK * column + row) + lane] = block[row, column]


@numba.njit(cache=True)
def _add_child(child, tree, updates, panel, update, own):
    """Add a child's update to its parent's panel and update, given by the places of their first tiles."""
    source = updates + TILE * tree.update_start[child]
    above = tree.above[tree.boundary_start[child] : tree.boundary_start[child + 1]]
    for row in range(above.shape[0]):
        row_above = above[row]
        for column in range(row + 1):
            column_above = above[column]
            if column_above < own:
                target = panel + TILE * (_strip(own, row_above) + column_above)
            else:
                target = update + TILE * _triangle(row_above - own, column_above - own)
            lanes.add_tile((target, source))
            source += TILE


@numba.njit(cache=True)
def _factorise_front(front, tree, blocks, first, panels, updates):
    """Factorise one front of a pack, tile by tile."""
    own, beyond = tree.own[front], tree.beyond[front]
    _gather_matrices(front, tree, blocks, first, panels)
    panel = panels.ctypes.data + TILE * tree.panel_start[front]
    stacks = updates.ctypes.data
    update = stacks + TILE * tree.update_start[front]
    size = LANES * _TILE_VECTORS * (beyond * (beyond + 1) // 2)
    updates[LANES * _TILE_VECTORS * tree.update_start[front] :][:size] = 0.0
    for child in tree.children[tree.child_start[front] : tree.child_start[front + 1]]:
        _add_child(child, tree, stacks, panel, update, own)
    for column in range(own):
        upper = panel + TILE * _strip(own, column)
        corner = upper + TILE * column
        lanes.subtract_strips((corner, upper, upper, BLOCK * column))
        lanes.factorise_tile((corner,))
        for row in range(column + 1, own + beyond):
            strip = panel + TILE * _strip(own, row)
            lanes.subtract_strips((strip + TILE * column, strip, upper, BLOCK * column))
            lanes.divide_tile((strip + TILE * column, corner))
    for column in range(beyond):
        upper = panel + TILE * _strip(own, own + column)
        for row in range(column, beyond):
            strip = panel + TILE * _strip(own, own + row)
            lanes.subtract_strips((update + TILE * _triangle(row, column), strip, upper, BLOCK * own))


@numba.njit(cache=True)
def _check_front(front, tree, panels, good):
    """Notes lanes whose matrix is not positive definite: a reciprocal on the diagonal is not positive or not finite."""
    own = tree.own[front]
    for row in range(own):
        tile = LANES * _TILE_VECTORS * (tree.panel_start[front] + _strip(own, row) + row)
        for axis in range(BLOCK):
            for lane in range(LANES):
                value = panels[tile + LANES * (BLOCK + 1) * axis + lane]
                if not (value > 0.0 and value < np.inf):
                    good[lane] = False


@numba.njit(cache=True)
def _factorise_part(part, tree, blocks, first, panels, updates, good):
    for place in range(tree.schedule_start[part], tree.schedule_start[part + 1]):
        _factorise_front(tree.schedule[place], tree, blocks, first, panels, updates)
        _check_front(tree.schedule[place], tree, panels, good)


@numba.njit(cache=True, parallel=True)
def _factorise_packs(tree, blocks, panels, updates):
    """Factorise all packs: the subtrees of all in parallel, then their tops."""
    packs, subtrees = panels.shape[0], tree.schedule_start.shape[0] - 2
    good = np.ones((packs, subtrees + 1, LANES), np.bool_)
    for job in numba.prange(packs * subtrees):
        pack, part = job // subtrees, job % subtrees
        _factorise_part(part, tree, blocks, LANES * pack, panels[pack], updates[pack], good[pack, part])
    for pack in numba.prange(packs):
        _factorise_part(subtrees, tree, blocks, LANES * pack, panels[pack], updates[pack], good[pack, subtrees])
    return good


@numba.njit(cache=True)
def _solve_forward(front, tree, panels, x, updates):
    """L y = b on one front: solve for the own unknowns and pass the rest up."""
    own, beyond = tree.own[front], tree.beyond[front]
    panel = panels + TILE * tree.panel_start[front]
    mine, size = x.ctypes.data + BLOCK * VECTOR * tree.start[front], LANES * BLOCK
    update = updates[size * tree.boundary_start[front] : size * tree.boundary_start[front + 1]]
    update[:] = 0.0
    for child in tree.children[tree.child_start[front] : tree.child_start[front + 1]]:
        for entry in range(tree.boundary_start[child], tree.boundary_start[child + 1]):
            row = tree.above[entry]
            go = x[size * (tree.start[front] + row) :] if row < own else update[size * (row - own) :]
            come = updates[size * entry : size * (entry + 1)]
            for number in range(size):
                go[number] += come[number]
    for row in range(own):
        strip, here = panel + TILE * _strip(own, row), mine + BLOCK * VECTOR * row
        lanes.subtract_strip_times((here, strip, mine, BLOCK * row))
        lanes.solve_tile((here, strip + TILE * row))
    for row in range(beyond):
        strip = panel + TILE * _strip(own, own + row)
        lanes.subtract_strip_times((update.ctypes.data + BLOCK * VECTOR * row, strip, mine, BLOCK * own))


@numba.njit(cache=True)
def _solve_backward(front, tree, panels, x):
    """L^T x = y on one front, whose boundary is solved already."""
    own, beyond = tree.own[front], tree.beyond[front]
    panel = panels + TILE * tree.panel_start[front]
    start, step = x.ctypes.data, BLOCK * VECTOR
    mine = start + step * tree.start[front]
    for row in range(beyond):
        strip = panel + TILE * _strip(own, own + row)
        known = start + step * tree.boundary[tree.boundary_start[front] + row]
        lanes.subtract_transposed_strip_times((mine, strip, known, BLOCK * own))
    for row in range(own - 1, -1, -1):
        strip, here = panel + TILE * _strip(own, row), mine + step * row
        lanes.solve_transposed_tile((here, strip + TILE * row))
        lanes.subtract_transposed_strip_times((mine, strip, here, BLOCK * row))


@numba.njit(cache=True)
def _in_elimination_order(tree, right, first, x):
    for place in range(tree.order.shape[0]):
        for lane in range(LANES):
            one = right[min(first + lane, right.shape[0] - 1), tree.order[place]]
            for axis in range(BLOCK):
                x[LANES * (BLOCK * place + axis) + lane] = one[axis]


@numba.njit(cache=True)
def _in_vertex_order(tree, x, first, out):
    for place in range(tree.order.shape[0]):
        for lane in range(min(LANES, out.shape[0] - first)):
            one = out[first + lane, tree.order[place]]
            for axis in range(BLOCK):
                one[axis] = x[LANES * (BLOCK * place + axis) + lane]


@numba.njit(cache=True, parallel=True)
def _solve_packs(tree, panels, right, out, x, updates):
    """Solve for one right-hand side of every matrix: the subtrees of all packs in parallel, then their tops."""
    packs, subtrees = panels.shape[0], tree.schedule_start.shape[0] - 2
    starts, schedule = tree.schedule_start, tree.schedule
    for pack in numba.prange(packs):
        _in_elimination_order(tree, right, LANES * pack, x[pack])
    for job in numba.prange(packs * subtrees):
        pack, part = job // subtrees, job % subtrees
        for place in range(starts[part], starts[part + 1]):
            _solve_forward(schedule[place], tree, panels[pack].ctypes.data, x[pack], updates[pack])
    for pack in numba.prange(packs):
        for place in range(starts[subtrees], starts[subtrees + 1]):
            _solve_forward(schedule[place], tree, panels[pack].ctypes.data, x[pack], updates[pack])
        for place in range(starts[subtrees + 1] - 1, starts[subtrees] - 1, -1):
            _solve_backward(schedule[place], tree, panels[pack].ctypes.data, x[pack])
    for job in numba.prange(packs * subtrees):
        pack, part = job // subtrees, job % subtrees
        for place in range(starts[part + 1] - 1, starts[part] - 1, -1):
            _solve_backward(schedule[place], tree, panels[pack].ctypes.data, x[pack])
    for pack in numba.prange(packs):
        _in_vertex_order(tree, x[pack], LANES * pack, out)


class LockstepFactor(Factor):
    """Cholesky factors of a batch, pack by pack."""

    def __init__(self, solver: "LockstepSolver", members: int) -> None:
        super().__init__(len(solver.tree.order), members)
        self.solver = solver
        self.panels = lanes.vectors(-(-members // LANES), _TILE_VECTORS * int(solver.tiles.panel_start[-1]))

    @property
    def nbytes(self) -> int:
        return self.panels.nbytes

    def _solve(self, right: Float[ndarray, "several vertices 3"]) -> Float[ndarray, "several vertices 3"]:
        out = np.empty_like(right)
        x, updates = self.solver.solve_storage(len(self.panels))
        _solve_packs(self.solver.tiles, self.panels, right, out, x, updates)
        return out


class LockstepSolver(MultifrontalSolver):
    """Single matrices as `multifrontal` does them, batches in lockstep; its factorisations share a workspace."""

    name = "lockstep"
    width = LANES

    @cached_property
    def tiles(self) -> TileTree:
        """The analysis in tiles."""
        return tile_tree(self.tree)

    @cached_property
    def _storage_of(self) -> dict[tuple[str, int], ndarray]:
        return {}

    def _vectors(self, name: str, packs: int, count: int) -> ndarray:
        """Workspace, used again for as many packs."""
        key = (name, packs)
        if key not in self._storage_of:
            self._storage_of[key] = lanes.vectors(packs, count)
        return self._storage_of[key]

    def solve_storage(self, packs: int) -> tuple[ndarray, ndarray]:
        """Workspace of a solve: unknowns in elimination order, and what fronts pass up.

        Args:
            packs: Number of packs.

        Returns:
            Arrays of vectors.
        """
        tiles = self.tiles
        return (
            self._vectors("x", packs, BLOCK * len(tiles.order)),
            self._vectors("passed", packs, BLOCK * len(tiles.boundary)),
        )

    def _factorise_batch(self, blocks: Float[ndarray, "members slots 3 3"], out: Factor | None) -> Factor:
        members = len(blocks)
        fits = isinstance(out, LockstepFactor) and out.solver is self and out.members == members
        factor = out if isinstance(out, LockstepFactor) and fits else LockstepFactor(self, members)
        packs = len(factor.panels)
        updates = self._vectors("updates", packs, _TILE_VECTORS * self.tiles.update_end)
        good = _factorise_packs(self.tiles, blocks, factor.panels, updates).all(1).reshape(-1)[:members]
        if not good.all():
            raise self._failure(blocks, ~good)
        return factor
