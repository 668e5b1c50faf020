"""Multifrontal Cholesky factorisation of block matrices, in numba with SciPy's dense kernels.

Front by front along the elimination tree: gather the matrix's blocks and the children's updates into a
dense panel, factorise it, and pass its Schur complement up. Subtrees run in parallel; a batch runs its
members in parallel. Every sum has one fixed order, so results are the same bits for any number of threads.

References:
    I. S. Duff, J. K. Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", ACM
        Trans. Math. Softw. 9 (1983).
    J. W. H. Liu, "The multifrontal method for sparse matrix solution", SIAM Rev. 34 (1992).
"""

from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.linear import dense
from cusick_bench.sim.linear.dissection import dissect
from cusick_bench.sim.linear.elimination import EliminationTree, analyse
from cusick_bench.sim.linear.interface import BLOCK, BlockPattern, Factor, LinearSolver
from cusick_bench.sim.threads import thread_pool

LEAF = 16
"""Vertices of a piece that is not dissected further. Measured: 12 to 32 are equally fast."""

STRIP = 24
"""Columns of a panel factorised at once. Measured: 18 to 36 are equally fast."""


@numba.njit(cache=True)
def _gather_matrix(front, tree, blocks, panel, height):
    """Put the matrix's blocks into a front's panel."""
    base = tree.panel_start[front]
    panel[:] = 0.0
    for entry in range(tree.slot_start[front], tree.slot_start[front + 1]):
        slot, target = tree.slots[entry], tree.targets[entry] - base
        for column in range(BLOCK):
            for row in range(BLOCK):
                panel[target + column * height + row] = blocks[slot, row, column]


@numba.njit(cache=True)
def _add_child(child, tree, updates, target, height, own, into_panel):
    """Add a child's update to its parent: to the own columns, in the parent's panel, or to the others."""
    shift = 0 if into_panel else own
    size = tree.sizes[child, 1]
    source = updates[tree.update_start[child] : tree.update_start[child] + size * size]
    runs = tree.runs[tree.run_start[child] : tree.run_start[child + 1]]
    for across in range(runs.shape[0]):
        first, end, first_above = runs[across]
        if (first_above < own) != into_panel:
            continue
        for column in range(first, end):
            column_above = (first_above - first + column - shift) * height - shift
            for down in range(across, runs.shape[0]):
                begin, stop, row_above = runs[down]
                skip = max(column - begin, 0)  # the lower triangle only
                come = source[column * size + begin + skip : column * size + stop]
                go = target[column_above + row_above + skip :]
                for row in range(come.shape[0]):
                    go[row] += come[row]


@numba.njit(cache=True)
def _factorise_panel(panel, own, height):
    """Cholesky factorisation of a panel, some columns at a time; False if it is not positive definite.

    Most of the work so becomes matrix products, which BLAS does several times as fast as triangular solves.
    """
    for first in range(0, own, STRIP):
        width = min(STRIP, own - first)
        strip = panel[first * height + first :]
        if first > 0:
            dense.subtract_product(panel[first:], panel[first:], strip, height - first, width, first, height)
        if not dense.cholesky(strip, width, height):
            return False
        for column in range(width):
            if not np.isfinite(strip[column * (height + 1)]):  # not every LAPACK reports NaN
                return False
        if first + width < height:
            dense.divide_by_transposed(strip, strip[width:], height - first - width, width, height)
    return True


@numba.njit(cache=True)
def _factorise_front(front, tree, blocks, panels, updates):
    """Factorise one front; False if it is not positive definite.

    With the front's matrix in four parts, own (o) and boundary (b): L_oo L_oo^T = F_oo, L_bo = F_bo
    L_oo^-T, and the update is F_bb - L_bo L_bo^T.
    """
    own, beyond = tree.sizes[front]
    height = own + beyond
    panel = panels[tree.panel_start[front] : tree.panel_start[front + 1]]
    update = updates[tree.update_start[front] : tree.update_start[front] + beyond * beyond]
    children = tree.children[tree.child_start[front] : tree.child_start[front + 1]]
    _gather_matrix(front, tree, blocks, panel, height)
    for child in children:
        _add_child(child, tree, updates, panel, height, own, True)
    if not _factorise_panel(panel, own, height):
        return False
    if beyond > 0:
        dense.negative_square(panel[own:], beyond, own, height, update)
        for child in children:
            _add_child(child, tree, updates, update, beyond, own, False)
    return True


@numba.njit(cache=True)
def _factorise_part(begin, end, tree, blocks, panels, updates):
    place = begin
    while place < end and _factorise_front(tree.schedule[place], tree, blocks, panels, updates):
        place += 1
    return place == end


@numba.njit(cache=True, parallel=True)
def _factorise(tree, blocks, panels, updates):
    """Factorise one matrix: subtrees in parallel, then the top."""
    parts = tree.schedule_start.shape[0] - 1
    good = np.ones(parts, np.bool_)
    for part in numba.prange(parts - 1):
        begin, end = tree.schedule_start[part], tree.schedule_start[part + 1]
        good[part] = _factorise_part(begin, end, tree, blocks, panels, updates)
    if good.all():
        begin, end = tree.schedule_start[parts - 1], tree.schedule_start[parts]
        good[-1] = _factorise_part(begin, end, tree, blocks, panels, updates)
    return good.all()


@numba.njit(cache=True, parallel=True)
def _factorise_members(tree, blocks, panels, updates):
    """Factorise a batch: the members are dealt out to workers, each with a workspace of its own."""
    workers, members = updates.shape[0], blocks.shape[0]
    good = np.ones(members, np.bool_)
    fronts = tree.schedule.shape[0]
    for worker in numba.prange(workers):
        for member in range(worker, members, workers):
            good[member] = _factorise_part(0, fronts, tree, blocks[member], panels[member], updates[worker])
    return good


@numba.njit(cache=True)
def _solve_forward(front, tree, panels, x, updates):
    """L y = b on one front: solve for the own unknowns and pass the rest up, as in factorising."""
    own, beyond = tree.sizes[front]
    panel = panels[tree.panel_start[front] : tree.panel_start[front + 1]]
    solution = x[BLOCK * tree.start[front] : BLOCK * tree.start[front + 1]]
    update = updates[BLOCK * tree.boundary_start[front] : BLOCK * tree.boundary_start[front + 1]]
    update[:] = 0.0
    for child in tree.children[tree.child_start[front] : tree.child_start[front + 1]]:
        come = updates[BLOCK * tree.boundary_start[child] : BLOCK * tree.boundary_start[child + 1]]
        for run in range(tree.run_start[child], tree.run_start[child + 1]):
            first, end, above = tree.runs[run]
            go = solution[above:] if above < own else update[above - own :]
            for row in range(end - first):
                go[row] += come[first + row]
    dense.solve_lower(panel, own, own + beyond, solution, False)
    if beyond > 0:
        dense.subtract_times(panel[own:], beyond, own, own + beyond, solution, update, False)


@numba.njit(cache=True)
def _solve_backward(front, tree, panels, x, updates):
    """L^T x = y on one front, whose boundary is solved already."""
    own, beyond = tree.sizes[front]
    panel = panels[tree.panel_start[front] : tree.panel_start[front + 1]]
    solution = x[BLOCK * tree.start[front] : BLOCK * tree.start[front + 1]]
    known = updates[BLOCK * tree.boundary_start[front] : BLOCK * tree.boundary_start[front + 1]]
    if beyond > 0:
        for row in range(beyond):
            place = tree.boundary[tree.boundary_start[front] + row // BLOCK]
            known[row] = x[BLOCK * place + row % BLOCK]
        dense.subtract_times(panel[own:], beyond, own, own + beyond, known, solution, True)
    dense.solve_lower(panel, own, own + beyond, solution, True)


@numba.njit(cache=True)
def _in_elimination_order(tree, right):
    x = np.empty(BLOCK * tree.order.shape[0])
    for place in range(tree.order.shape[0]):
        for axis in range(BLOCK):
            x[BLOCK * place + axis] = right[tree.order[place], axis]
    return x


@numba.njit(cache=True)
def _in_vertex_order(tree, x, out):
    for place in range(tree.order.shape[0]):
        for axis in range(BLOCK):
            out[tree.order[place], axis] = x[BLOCK * place + axis]


@numba.njit(cache=True, parallel=True)
def _solve(tree, panels, right, out):
    """Solve for one right-hand side: subtrees in parallel."""
    x = _in_elimination_order(tree, right)
    updates = np.empty(BLOCK * tree.boundary.shape[0])
    starts, parts = tree.schedule_start, tree.schedule_start.shape[0] - 1
    for part in numba.prange(parts - 1):
        for place in range(starts[part], starts[part + 1]):
            _solve_forward(tree.schedule[place], tree, panels, x, updates)
    for place in range(starts[parts - 1], starts[parts]):
        _solve_forward(tree.schedule[place], tree, panels, x, updates)
    for place in range(starts[parts] - 1, starts[parts - 1] - 1, -1):
        _solve_backward(tree.schedule[place], tree, panels, x, updates)
    for part in numba.prange(parts - 1):
        for place in range(starts[part + 1] - 1, starts[part] - 1, -1):
            _solve_backward(tree.schedule[place], tree, panels, x, updates)
    _in_vertex_order(tree, x, out)


@numba.njit(cache=True, parallel=True)
def _solve_members(tree, panels, right, out):
    """Solve for several right-hand sides in parallel, with one factor or with one factor each."""
    fronts = tree.schedule.shape[0]
    for member in numba.prange(right.shape[0]):
        x = _in_elimination_order(tree, right[member])
        updates = np.empty(BLOCK * tree.boundary.shape[0])
        panel = panels[member % panels.shape[0]]
        for place in range(fronts):
            _solve_forward(tree.schedule[place], tree, panel, x, updates)
        for place in range(fronts - 1, -1, -1):
            _solve_backward(tree.schedule[place], tree, panel, x, updates)
        _in_vertex_order(tree, x, out[member])


class MultifrontalFactor(Factor):
    """Cholesky factors of one matrix or of a batch: nothing but their panels."""

    def __init__(self, tree: EliminationTree, panels: Float[ndarray, "factors numbers"], members: int | None) -> None:
        super().__init__(len(tree.order), members)
        self.tree, self.panels = tree, panels

    @property
    def nbytes(self) -> int:
        return self.panels.nbytes

    def _solve(self, right: Float[ndarray, "several vertices 3"]) -> Float[ndarray, "several vertices 3"]:
        out = np.empty_like(right)
        with dense.single_threaded():
            if len(right) == 1:
                _solve(self.tree, self.panels[0], right[0], out[0])
            else:
                _solve_members(self.tree, self.panels, right, out)
        return out


class MultifrontalSolver(LinearSolver):
    """Default backend. Its factorisations share a workspace."""

    name = "multifrontal"

    def __init__(self, pattern: BlockPattern, *, leaf: int = LEAF) -> None:
        super().__init__(pattern)
        thread_pool()
        self.tree = analyse(pattern, dissect(pattern, leaf), numba.get_num_threads())
        self._updates = np.empty((1, self.tree.update_end))

    @cached_property
    def needed_slots(self) -> Int[ndarray, " needed"]:
        return np.sort(self.tree.slots)

    def _factorise(self, blocks: Float[ndarray, "slots 3 3"], out: Factor | None) -> Factor:
        factor = self._storage(out, None)
        with dense.single_threaded():
            if not _factorise(self.tree, blocks, factor.panels[0], self._updates[0]):
                raise self._failure(blocks)
        return factor

    def _factorise_batch(self, blocks: Float[ndarray, "members slots 3 3"], out: Factor | None) -> Factor:
        factor = self._storage(out, len(blocks))
        workers = min(len(blocks), numba.get_num_threads())
        if len(self._updates) < workers:
            self._updates = np.empty((workers, self.tree.update_end))
        with dense.single_threaded():
            good = _factorise_members(self.tree, blocks, factor.panels, self._updates[:workers])
        if not good.all():
            raise self._failure(blocks, ~good)
        return factor

    def _storage(self, out: Factor | None, members: int | None) -> MultifrontalFactor:
        """`out` if it fits, else new storage."""
        if isinstance(out, MultifrontalFactor) and out.tree is self.tree and out.members == members:
            return out
        return MultifrontalFactor(self.tree, np.empty((members or 1, self.tree.panel_start[-1])), members)
