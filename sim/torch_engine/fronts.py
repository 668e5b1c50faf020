"""Index tables of the batched multifrontal factorisation: fronts of one depth and like size, padded to one size.

A group holds fronts of equal depth in the elimination tree, so that all of them, for all members of a batch, are
factorised in one call. Each front's rows are its own unknowns, padded to `own`, then its boundary, padded to `beyond`.
Only lower triangles are ever read.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.linear.elimination import EliminationTree
from cusick_bench.sim.linear.interface import BLOCK

GROUP_COST = 8000
"""What one more group costs in kernel launches, as the numbers of a front that are handled meanwhile."""


@dataclass(frozen=True, eq=False)
class Passing:
    """Updates from fronts of one group to fronts of another, at most one to each, as places in flattened arrays.

    Attributes:
        group: The children's group.
        rows: Boundary rows (fronts, beyond) of the children that have a row in the parents.
        rows_there: Those rows (fronts, height) there.
        numbers: Numbers (fronts, beyond, beyond) of the lower triangles of their updates.
        numbers_there: Their places (fronts, height, height) there; no place twice.
    """

    group: int
    rows: Int[Tensor, "rows"]
    rows_there: Int[Tensor, "rows"]
    numbers: Int[Tensor, "numbers"]
    numbers_there: Int[Tensor, "numbers"]


@dataclass(frozen=True, eq=False)
class FrontGroup:
    """Fronts that are factorised together.

    Attributes:
        fronts: Number of fronts of the group.
        own: Own unknowns of each, padding included.
        beyond: Boundary unknowns of each, padding included.
        filled: Places of the matrix's numbers in (fronts, height, height), flattened.
        slots: The slots, in the solver's order, that they come from.
        units: Places of the ones on the padded diagonal.
        unknowns: Unknown of every own row; padding points at unknowns of its own behind all others.
        known: Unknown of every boundary row; padding points at the one behind the last, always 0.
        passings: What the fronts take in.
    """

    fronts: int
    own: int
    beyond: int
    filled: Int[Tensor, "numbers"]
    slots: slice
    units: Int[Tensor, "padding"]
    unknowns: Int[Tensor, "fronts own"]
    known: Int[Tensor, "fronts beyond"]
    passings: list[Passing]


@dataclass(frozen=True, eq=False)
class FrontPlan:
    """The whole factorisation.

    Attributes:
        groups: Children before parents.
        slots: Slots of the pattern that are read, in the order in which the groups take them.
        spent: Groups whose updates nobody takes in after each group.
        unknowns: Length of the vector of unknowns, padding included.
    """

    groups: list[FrontGroup]
    spent: list[list[int]]
    slots: Int[ndarray, "needed"]
    unknowns: int


def plan_fronts(tree: EliminationTree, device: str, group_cost: int = GROUP_COST) -> FrontPlan:
    """Lays out the groups of an elimination tree on a device.

    Args:
        tree: The analysed pattern.
        device: Torch device.
        group_cost: Operations that starting one more group costs.

    Returns:
        Groups of equal fronts, from the leaves up.
    """
    parent = _parents(tree)
    own, beyond = tree.sizes.T
    members: list[list[int]] = [
        group for fronts in _by_depth(parent) for group in _alike(fronts, own, beyond, group_cost)
    ]
    place = {front: (g, i) for g, group in enumerate(members) for i, front in enumerate(group)}
    groups, slots, end = [], [], BLOCK * len(tree.order) + 1
    for fronts in members:
        groups.append(_group(tree, fronts, place, groups, end, device))
        slots += [tree.slots[tree.slot_start[f] : tree.slot_start[f + 1]] for f in fronts]
        end += groups[-1].fronts * groups[-1].own
    last = {come.group: number for number, group in enumerate(groups) for come in group.passings}
    spent = [[child for child, user in last.items() if user == number] for number in range(len(groups))]
    return FrontPlan(groups, spent, np.concatenate(slots), end)


def _parents(tree: EliminationTree) -> Int[ndarray, "fronts"]:
    parent = np.full(len(tree.sizes), -1)
    parent[tree.children] = np.repeat(np.arange(len(parent)), np.diff(tree.child_start))
    return parent


def _by_depth(parent: ndarray) -> list[list[int]]:
    """Fronts of every depth, deepest first."""
    depth = np.zeros(len(parent), np.int64)
    for front in reversed(range(len(parent))):  # parents come after their children
        depth[front] = 0 if parent[front] < 0 else depth[parent[front]] + 1
    return [np.flatnonzero(depth == level).tolist() for level in reversed(range(depth.max() + 1))]


def _alike(fronts: list[int], own: ndarray, beyond: ndarray, group_cost: int) -> list[list[int]]:
    """Splits fronts into groups of like size, at the least cost of padded matrices and groups.

    Dynamic programme over fronts sorted by size: a group is a stretch of them.
    """
    fronts = sorted(fronts, key=lambda front: int(own[front] + beyond[front]))
    best: list[tuple[int, list[list[int]]]] = [(0, [])]
    for end in range(1, len(fronts) + 1):
        choices = []
        for first in range(end):
            group = fronts[first:end]
            cost = int((own[group].max() + beyond[group].max()) ** 2) * len(group) + group_cost
            choices.append((best[first][0] + cost, [*best[first][1], group]))
        best.append(min(choices, key=lambda choice: choice[0]))
    return best[-1][1]


def _group(
    tree: EliminationTree, fronts: list[int], place: dict[int, tuple[int, int]], earlier: list[FrontGroup], end: int,
    device: str,
) -> FrontGroup:  # fmt: skip
    sizes = tree.sizes[fronts]
    own, beyond = int(sizes[:, 0].max()), max(int(sizes[:, 1].max()), 1)
    height, nothing = own + beyond, BLOCK * len(tree.order)
    unknowns = end + np.arange(len(fronts) * own).reshape(len(fronts), own)
    known = np.full((len(fronts), beyond), nothing)
    filled, units = [], []
    for i, front in enumerate(fronts):
        mine, boundary = tree.sizes[front]
        unknowns[i, :mine] = _unknowns(tree, np.arange(tree.start[front], tree.start[front + 1]))
        known[i, :boundary] = _unknowns(tree, _boundary(tree, front))
        filled.append(i * height**2 + _places(tree, front, own, height))
        units.append(i * height**2 + np.arange(mine, own) * (height + 1))
    first = earlier[-1].slots.stop if earlier else 0
    slots = slice(first, first + sum(len(some) for some in filled))

    def put(array: ndarray) -> Tensor:
        return torch.as_tensor(array, device=device)

    passings = _passings(tree, fronts, place, earlier, own, height, device)
    return FrontGroup(
        len(fronts), own, beyond, put(np.concatenate(filled).ravel()), slots, put(np.concatenate(units)),
        put(unknowns), put(known), passings,
    )  # fmt: skip


def _boundary(tree: EliminationTree, front: int) -> ndarray:
    return tree.boundary[tree.boundary_start[front] : tree.boundary_start[front + 1]]


def _unknowns(tree: EliminationTree, positions: ndarray) -> ndarray:
    """Unknowns of vertices given by their positions in elimination order."""
    return (BLOCK * tree.order[positions][:, None] + np.arange(BLOCK)).ravel()


def _places(tree: EliminationTree, front: int, own: int, height: int) -> Int[ndarray, "slots 3 3"]:
    """Place of every number of a front's blocks in its padded matrix, rows first."""
    mine, actual = tree.sizes[front, 0], tree.sizes[front].sum()
    targets = tree.targets[tree.slot_start[front] : tree.slot_start[front + 1]] - tree.panel_start[front]
    column, row = np.divmod(targets, actual)
    row = np.where(row < mine, row, row - mine + own)
    axis = np.arange(BLOCK)
    return (row[:, None, None] + axis[:, None]) * height + column[:, None, None] + axis


def _passings(
    tree: EliminationTree, fronts: list[int], place: dict[int, tuple[int, int]], earlier: list[FrontGroup], own: int,
    height: int, device: str,
) -> list[Passing]:  # fmt: skip
    """Children sorted by their group, and by how many of the same parent came before from it."""
    found: dict[tuple[int, int], list[tuple[ndarray, ...]]] = {}
    for i, front in enumerate(fronts):
        before: dict[int, int] = {}
        for child in tree.children[tree.child_start[front] : tree.child_start[front + 1]].tolist():
            group, j = place[child]
            turn = before[group] = before.get(group, -1) + 1
            there = _rows(tree, child, int(tree.sizes[front, 0]), own)
            beyond, (row, column) = earlier[group].beyond, np.tril_indices(len(there))
            rows = j * beyond + np.arange(len(there)), i * height + there
            numbers = (j * beyond + row) * beyond + column, (i * height + there[row]) * height + there[column]
            found.setdefault((group, turn), []).append((*rows, *numbers))
    return [
        Passing(group, *(torch.as_tensor(np.concatenate(part), device=device) for part in zip(*parts, strict=True)))
        for (group, _), parts in sorted(found.items(), key=lambda item: item[0])
    ]


def _rows(tree: EliminationTree, child: int, mine: int, own: int) -> Int[ndarray, "boundary"]:
    """Row of every boundary row of a child in its parent's padded front, which has `mine` of `own` unknowns."""
    rows = np.empty(tree.sizes[child, 1], np.int64)
    for first, stop, above in tree.runs[tree.run_start[child] : tree.run_start[child + 1]]:
        rows[first:stop] = np.arange(stop - first) + (above if above < mine else above - mine + own)
    return rows
