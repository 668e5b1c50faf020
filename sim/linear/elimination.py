"""Symbolic analysis of a multifrontal factorisation: contents and places of the fronts, and their schedule.

A front eliminates its `own` vertices. Its rows are these and, below them, its `boundary`: the later
vertices that they are coupled to, directly or through fill. The front's columns of the factor (its panel)
are kept; its Schur complement on the boundary (its update) is added to its parent's front and then dropped.

Everything here depends on the pattern only and is done once.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Int
from numpy import ndarray

from cusick_bench.sim.linear.dissection import Dissection
from cusick_bench.sim.linear.interface import BLOCK, BlockPattern


class EliminationTree(NamedTuple):
    """Arrays that the numeric kernels follow. `x_start[f] : x_start[f + 1]` is front f's part of the array x.

    Attributes:
        order: Vertices in elimination order.
        start: First position in `order` of each front, and the end.
        sizes: Unknowns of each front: own and boundary.
        boundary_start, boundary: Positions in elimination order, ascending.
        run_start, runs: Boundary rows that stay side by side in the parent's front: first, end, first there.
        child_start, children: Fronts whose updates a front takes in.
        slot_start, slots, targets: Blocks of the matrix, and where in the factor each one's corner goes.
        panel_start: Panels in the factor; columns one after the other, each of own and boundary rows.
        update_start: Update matrices in the workspace.
        update_end: Size of the workspace.
        schedule_start, schedule: Fronts in working order. All parts but the last are independent.
    """

    order: Int[ndarray, " vertices"]
    start: Int[ndarray, " fronts_and_end"]
    sizes: Int[ndarray, "fronts 2"]
    boundary_start: Int[ndarray, " fronts_and_end"]
    boundary: Int[ndarray, " entries"]
    run_start: Int[ndarray, " fronts_and_end"]
    runs: Int[ndarray, "runs 3"]
    child_start: Int[ndarray, " fronts_and_end"]
    children: Int[ndarray, " others"]
    slot_start: Int[ndarray, " fronts_and_end"]
    slots: Int[ndarray, " needed"]
    targets: Int[ndarray, " needed"]
    panel_start: Int[ndarray, " fronts_and_end"]
    update_start: Int[ndarray, " fronts"]
    update_end: int
    schedule_start: Int[ndarray, " parts_and_end"]
    schedule: Int[ndarray, " fronts"]


def analyse(pattern: BlockPattern, dissection: Dissection, workers: int) -> EliminationTree:
    """Symbolic analysis of a pattern in a given order, for `workers` threads.

    Args:
        pattern: The coupled vertices.
        dissection: Their order.
        workers: Number of threads.

    Returns:
        Fronts, where their numbers lie, and who works on them.
    """
    start, parent = dissection.start, dissection.parent
    children = _grouped(parent)
    columns = _lower_columns(pattern, dissection.order)
    boundaries = _boundaries(columns, start, children)
    own = np.diff(start)
    beyond = np.array([len(boundary) for boundary in boundaries])
    panel_start = _ends(BLOCK * BLOCK * own * (own + beyond))
    fronts = range(len(own))
    scattered = [_scatter(columns, start, front, boundaries[front], int(panel_start[front])) for front in fronts]
    runs = [_runs(front, int(parent[front]), boundaries, start) for front in fronts]
    parts = schedule(parent, children, _work(own, beyond), workers)
    update_start, update_end = stack_updates(parts, parent, children, (BLOCK * beyond) ** 2)
    return EliminationTree(
        order=dissection.order,
        start=start,
        sizes=BLOCK * np.stack([own, beyond], axis=1),
        boundary_start=_ends(beyond),
        boundary=np.concatenate(boundaries),
        run_start=_ends([len(some) for some in runs]),
        runs=BLOCK * np.concatenate(runs),
        child_start=_ends([len(group) for group in children]),
        children=np.concatenate([*children, np.empty(0)]).astype(np.int64),
        slot_start=_ends([len(slots) for slots, _ in scattered]),
        slots=np.concatenate([slots for slots, _ in scattered]),
        targets=np.concatenate([targets for _, targets in scattered]),
        panel_start=panel_start,
        update_start=update_start,
        update_end=update_end,
        schedule_start=_ends([len(part) for part in parts]),
        schedule=np.concatenate(parts).astype(np.int64),
    )


def _ends(counts) -> ndarray:
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])


def _grouped(parent: Int[ndarray, " fronts"]) -> list[list[int]]:
    """Children of every front, ascending."""
    children: list[list[int]] = [[] for _ in parent]
    for front, above in enumerate(parent):
        if above >= 0:
            children[above].append(front)
    return children


def _lower_columns(pattern: BlockPattern, order: Int[ndarray, " vertices"]) -> sparse.csc_array:
    """The lower triangle in elimination order, by columns; the values are the slots of the pattern."""
    position = np.empty_like(order)
    position[order] = np.arange(len(order))
    row, column = position[pattern.rows], position[pattern.indices]
    slot = np.flatnonzero(row >= column)
    shape = (len(order), len(order))
    columns = sparse.coo_array((slot, (row[slot], column[slot])), shape=shape).tocsc()
    columns.sort_indices()
    return columns


def _boundaries(columns: sparse.csc_array, start: ndarray, children: list[list[int]]) -> list[ndarray]:
    """Boundary of every front: its own vertices' later neighbours and what its children pass on."""
    boundaries: list[ndarray] = []
    for front, end in enumerate(start[1:]):
        reached = [columns.indices[columns.indptr[start[front]] : columns.indptr[end]]]
        reached += [boundaries[child] for child in children[front]]
        union = np.unique(np.concatenate(reached)).astype(np.int64)
        boundaries.append(union[np.searchsorted(union, end) :])
    return boundaries


def _runs(front: int, above: int, boundaries: list[ndarray], start: ndarray) -> Int[ndarray, "runs 3"]:
    """Runs of boundary rows that go to successive rows of the parent's front, own or boundary ones there."""
    boundary = boundaries[front]
    if above < 0:
        return np.empty((0, 3), np.int64)
    first_above, end_above = int(start[above]), int(start[above + 1])
    rows = _rows(boundary, first_above, end_above, boundaries[above])
    breaks = (np.diff(rows) != 1) | (rows[1:] == end_above - first_above)
    first = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    return np.stack([first, np.append(first[1:], len(rows)), rows[first]], axis=1)


def _rows(positions: ndarray, first: int, end: int, boundary: ndarray) -> ndarray:
    """Row, in the front that owns first:end, of vertices given by their positions in elimination order."""
    return np.where(positions < end, positions - first, end - first + np.searchsorted(boundary, positions))


def _scatter(
    columns: sparse.csc_array, start: ndarray, front: int, boundary: ndarray, panel: int
) -> tuple[ndarray, ndarray]:
    """Slots of the matrix in a front's panel and the place in the factor of each one's corner."""
    first, end = int(start[front]), int(start[front + 1])
    entries = slice(columns.indptr[first], columns.indptr[end])
    row = _rows(columns.indices[entries].astype(np.int64), first, end, boundary)
    column = np.repeat(np.arange(end - first), np.diff(columns.indptr[first : end + 1]))
    height = BLOCK * (end - first + len(boundary))
    return columns.data[entries], panel + BLOCK * (column * height + row)


def _work(own: ndarray, beyond: ndarray) -> ndarray:
    """Multiplications of every front, in blocks, and a constant for the calls."""
    return own**3 / 3 + own**2 * beyond + own * beyond**2 + 1000.0


def schedule(parent: ndarray, children: list[list[int]], work: ndarray, workers: int) -> list[list[int]]:
    """Share the forest out: one list of whole subtrees per worker, and last the fronts above them.

    Starts from the roots and cuts the heaviest subtree open as long as that shortens the estimated time.

    Args:
        parent: Parent of every front, -1 for a root.
        children: Children of every front.
        work: Estimated operations of every front.
        workers: Number of threads.

    Returns:
        Fronts in the order of their elimination, a list for each worker, then one for those that come last.
    """
    below = np.array(work)
    for front, above in enumerate(parent):
        if above >= 0:
            below[above] += below[front]
    subtrees, top = [int(root) for root in np.flatnonzero(parent < 0)], []
    best = (np.inf, [], [])
    while True:
        loads, shares = _packed(subtrees, below, workers)
        time = max(loads) + work[top].sum()
        if time < best[0]:
            best = (time, shares, sorted(top))
        heaviest = max(subtrees, key=lambda front: below[front])
        if workers == 1 or not children[heaviest] or work[top].sum() > best[0]:
            break
        subtrees.remove(heaviest)
        subtrees += children[heaviest]
        top.append(heaviest)
    _, shares, top = best
    return [[front for root in share for front in _postorder(root, children)] for share in shares] + [top]


def _packed(subtrees: list[int], below: ndarray, workers: int) -> tuple[list[float], list[list[int]]]:
    """Longest job first: every subtree goes to the worker with the least to do."""
    loads, shares = [0.0] * workers, [[] for _ in range(workers)]
    for root in sorted(subtrees, key=lambda front: -below[front]):
        least = loads.index(min(loads))
        loads[least] += below[root]
        shares[least].append(root)
    return loads, shares


def _postorder(root: int, children: list[list[int]]) -> list[int]:
    fronts, waiting = [], [root]
    while waiting:
        fronts.append(waiting.pop())
        waiting += children[fronts[-1]]
    return fronts[::-1]


def stack_updates(
    parts: list[list[int]], parent: ndarray, children: list[list[int]], sizes: ndarray
) -> tuple[Int[ndarray, " fronts"], int]:
    """Place of every update in the workspace, and the size of the workspace.

    Each part has two stacks, one for even and one for odd depths: while a front puts its update on one
    stack, its children's lie on top of the other and can be dropped right after. Memory stays small and
    warm in the cache.

    Args:
        parts: Fronts in working order, those of each worker and those that come last.
        parent: Parent of every front, -1 for a root.
        children: Children of every front.
        sizes: Size of every front's update.

    Returns:
        Start of every update, and size of the workspace.
    """
    side = np.zeros(len(parent), np.int64)
    for front in reversed(range(len(parent))):
        side[front] = 0 if parent[front] < 0 else 1 - side[parent[front]]
    place, end = np.zeros(len(parent), np.int64), 0
    for part in parts:
        top, peak, inside = [0, 0], [0, 0], set(part)
        for front in part:
            here, there = side[front], 1 - side[front]
            place[front] = top[here]
            top[here] += sizes[front]
            peak[here] = max(peak[here], top[here])
            top[there] = min((place[child] for child in children[front] if child in inside), default=top[there])
        place[part] += end + side[part] * peak[0]
        end += sum(peak)
    return place, int(end)
