"""Linear solvers: the same contract for every backend installed, and the default's own promises."""

import subprocess
import sys
from functools import partial

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.spatial import Delaunay
from threadpoolctl import threadpool_info, threadpool_limits

from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.linear import dense
from cusick_bench.sim.linear.dissection import dissect
from cusick_bench.sim.linear.elimination import analyse
from cusick_bench.sim.linear.interface import (
    BlockPattern,
    LinearSolver,
    NotPositiveDefinite,
    available_backends,
    solver,
)
from cusick_bench.sim.linear.lanes import LANES
from cusick_bench.sim.linear.multifrontal import MultifrontalSolver


def cloth_pattern(vertices: int, seed: int = 0) -> BlockPattern:
    """Random points in a disc, triangulated; coupled are vertices of one triangle and opposites across an edge."""
    generator = np.random.default_rng(seed)
    radius, angle = np.sqrt(generator.random(vertices)), 2 * np.pi * generator.random(vertices)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    mesh = Delaunay(points)
    couplings = [mesh.simplices[:, [0, 1]], mesh.simplices[:, [1, 2]], mesh.simplices[:, [2, 0]]]
    for corner in range(3):
        beyond = mesh.neighbors[:, corner]
        inner = np.flatnonzero(beyond >= 0)
        there = mesh.simplices[beyond[inner]]
        opposite = there[mesh.neighbors[beyond[inner]] == inner[:, None]]
        couplings.append(np.stack([mesh.simplices[inner, corner], opposite], axis=1))
    return BlockPattern.from_couplings(points, np.concatenate(couplings))


def random_blocks(pattern: BlockPattern, seed: int = 0, floor: float = 0.1) -> np.ndarray:
    """A random symmetric positive definite matrix: a spring with a random stiffness matrix at every coupling."""
    generator = np.random.default_rng(seed)
    row, column = pattern.rows, pattern.indices
    upper = np.flatnonzero(row < column)
    mirror = np.lexsort((row, column))  # slot of (j, i) for the slot of (i, j), as the pattern is symmetric
    root = generator.normal(size=(len(upper), 3, 3))
    stiffness = root @ root.transpose(0, 2, 1)
    blocks = np.zeros((pattern.slots, 3, 3))
    blocks[upper] = blocks[mirror[upper]] = -stiffness
    diagonal = np.flatnonzero(row == column)
    blocks[diagonal] = floor * np.eye(3)
    np.add.at(blocks, diagonal[row[upper]], stiffness)
    np.add.at(blocks, diagonal[column[upper]], stiffness)
    return blocks


def as_matrix(pattern: BlockPattern, blocks: np.ndarray) -> sparse.csr_array:
    size = (3 * pattern.vertices,) * 2
    return sparse.bsr_array((blocks, pattern.indices, pattern.indptr), shape=size).tocsr()


def right_side(pattern: BlockPattern, *several: int) -> np.ndarray:
    return np.random.default_rng(7).normal(size=(*several, pattern.vertices, 3))


@pytest.fixture(params=available_backends())
def backend(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def pattern() -> BlockPattern:
    return cloth_pattern(297)


@pytest.fixture(scope="module")
def default(pattern) -> MultifrontalSolver:
    return MultifrontalSolver(pattern)


@pytest.mark.parametrize("vertices", [4, 30, 120, 297])
def test_solves_like_numpy(backend, vertices):
    pattern = cloth_pattern(vertices, seed=vertices)
    blocks, right = random_blocks(pattern), right_side(pattern)
    expected = np.linalg.solve(as_matrix(pattern, blocks).toarray(), right.ravel()).reshape(-1, 3)
    solution = solver(pattern, backend).factorise(blocks).solve(right)
    np.testing.assert_allclose(solution, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_residual_at_the_size_of_the_paper(backend):
    pattern = cloth_pattern(2699)
    blocks, right = random_blocks(pattern), right_side(pattern)
    solution = solver(pattern, backend).factorise(blocks).solve(right)
    residual = as_matrix(pattern, blocks) @ solution.ravel() - right.ravel()
    assert np.abs(residual).max() < 1e-10


def test_agrees_with_splu_at_the_size_of_the_paper():
    pattern = cloth_pattern(2699, seed=1)
    blocks, right = random_blocks(pattern, floor=1.0), right_side(pattern)
    ours, theirs = (solver(pattern, name).factorise(blocks).solve(right) for name in ("multifrontal", "splu"))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * np.abs(theirs).max())


def test_scalar_stiffness_gives_the_exact_solution(backend):
    """A chain of unit springs held at its ends sags in a parabola: x_i = i (n + 1 - i) / 2 under unit loads."""
    count = 41
    index = np.arange(count)
    pattern = BlockPattern.from_couplings(np.stack([1.0 * index, 0.0 * index], 1), np.stack([index[1:], index[:-1]], 1))
    blocks = np.where((pattern.rows == pattern.indices)[:, None, None], 2.0, -1.0) * np.eye(3)
    sag = solver(pattern, backend).factorise(blocks).solve(np.ones((count, 3)))
    exact = (index + 1) * (count - index) / 2
    np.testing.assert_allclose(sag, np.stack([exact] * 3, axis=1), rtol=1e-12)


def test_disconnected_parts(backend):
    one, two = cloth_pattern(90, seed=3), cloth_pattern(50, seed=4)
    points = np.concatenate([one.points, two.points + 0.3, [[5.0, 5.0], [5.0, 5.0]]])
    couplings = [np.stack([one.rows, one.indices], 1), 90 + np.stack([two.rows, two.indices], 1)]
    pattern = BlockPattern.from_couplings(points, np.concatenate(couplings))
    blocks, right = random_blocks(pattern), right_side(pattern)
    expected = np.linalg.solve(as_matrix(pattern, blocks).toarray(), right.ravel()).reshape(-1, 3)
    solution = solver(pattern, backend).factorise(blocks).solve(right)
    np.testing.assert_allclose(solution, expected, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(solution[-2:], right[-2:] / 0.1, rtol=1e-12)


def test_a_single_vertex(backend):
    pattern = BlockPattern.from_couplings(np.zeros((1, 2)), np.empty((0, 2), int))
    block = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 2.0]])
    solution = solver(pattern, backend).factorise(block[None]).solve(np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(block @ solution[0], [1.0, 2.0, 3.0], rtol=1e-13)


def test_everything_coupled_with_everything(backend):
    points = np.random.default_rng(0).normal(size=(60, 2))
    pattern = BlockPattern.from_couplings(points, np.stack(np.triu_indices(60), axis=1))
    blocks, right = random_blocks(pattern), right_side(pattern)
    solution = solver(pattern, backend).factorise(blocks).solve(right)
    np.testing.assert_allclose(as_matrix(pattern, blocks) @ solution.ravel(), right.ravel(), atol=1e-10)


def test_several_right_hand_sides(backend, pattern):
    factor = solver(pattern, backend).factorise(random_blocks(pattern))
    right = right_side(pattern, 5)
    together = factor.solve(right)
    for one, solution in zip(right, together, strict=True):
        np.testing.assert_allclose(factor.solve(one), solution, rtol=0, atol=1e-12 * np.abs(together).max())


@pytest.mark.parametrize("where", ["first", "last", "slightly"])
def test_not_positive_definite_is_told(backend, pattern, where):
    blocks = random_blocks(pattern)
    diagonal = np.flatnonzero(pattern.rows == pattern.indices)
    if where == "slightly":
        lowest = np.linalg.eigvalsh(as_matrix(pattern, blocks).toarray())[0]
        blocks[diagonal] -= 1.001 * lowest * np.eye(3)
    else:
        blocks[diagonal[0 if where == "first" else -1]] -= 100 * np.eye(3)
    linear = solver(pattern, backend)
    with pytest.raises(NotPositiveDefinite, match="diagonal") as caught:
        linear.factorise(blocks)
    assert isinstance(caught.value, ArithmeticError)
    linear.factorise(random_blocks(pattern))  # and the solver is none the worse for it


def test_a_kept_factor_stays_valid(backend, pattern):
    linear, right = solver(pattern, backend), right_side(pattern)
    kept = linear.factorise(random_blocks(pattern, seed=1))
    before = kept.solve(right)
    linear.factorise(random_blocks(pattern, seed=2)).solve(right)
    np.testing.assert_array_equal(kept.solve(right), before)


def test_storage_is_used_again(backend, pattern):
    linear, right = solver(pattern, backend), right_side(pattern)
    old = linear.factorise(random_blocks(pattern, seed=1))
    new = linear.factorise(random_blocks(pattern, seed=2), out=old)
    expected = linear.factorise(random_blocks(pattern, seed=2)).solve(right)
    np.testing.assert_allclose(new.solve(right), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_batch_equals_singles(backend, pattern):
    linear = solver(pattern, backend)
    blocks = np.stack([random_blocks(pattern, seed=seed) for seed in range(5)])
    right = right_side(pattern, 5)
    batch = linear.factorise_batch(blocks)
    singles = [linear.factorise(one).solve(b) for one, b in zip(blocks, right, strict=True)]
    assert batch.members == 5
    compare = np.testing.assert_array_equal
    if backend in ("pardiso", "lockstep"):  # other sums than for single matrices
        compare = partial(np.testing.assert_allclose, rtol=0, atol=1e-13 * np.abs(singles).max())
    compare(batch.solve(right), np.stack(singles))
    again = linear.factorise_batch(blocks[::-1], out=batch)
    compare(again.solve(right[::-1]), np.stack(singles)[::-1])


def test_batch_with_one_bad_member_is_told(backend, pattern):
    blocks = np.stack([random_blocks(pattern, seed=seed) for seed in range(3)])
    blocks[1, pattern.rows == pattern.indices] -= 100 * np.eye(3)
    with pytest.raises(NotPositiveDefinite) as caught:
        solver(pattern, backend).factorise_batch(blocks)
    np.testing.assert_array_equal(caught.value.members, [False, True, False])


@pytest.fixture(scope="module")
def lockstep(pattern) -> LinearSolver:
    return solver(pattern, "lockstep")


def test_lockstep_gives_the_same_bits_in_any_batch_and_place(lockstep, pattern):
    blocks = np.stack([random_blocks(pattern, seed=seed) for seed in range(LANES + 3)])
    right = right_side(pattern, len(blocks))
    expected = lockstep.factorise_batch(blocks).solve(right)
    for some in ([5, 2], [10, 9, 8, 7], [1, *range(LANES + 3)]):
        np.testing.assert_array_equal(lockstep.factorise_batch(blocks[some]).solve(right[some]), expected[some])


@pytest.mark.parametrize("where", ["first", "middle", "last"])
def test_lockstep_tells_bad_members_wherever_the_matrix_is_bad(lockstep, pattern, where):
    """One vertex, the first, some, or the last to be eliminated, makes two of the members indefinite or singular."""
    blocks = np.stack([random_blocks(pattern, seed=seed) for seed in range(LANES + 3)])
    order = lockstep.tree.order
    vertex = order[{"first": 0, "middle": len(order) // 2, "last": -1}[where]]
    of_vertex = (pattern.rows == vertex) | (pattern.indices == vertex)
    blocks[2, (pattern.rows == vertex) & (pattern.indices == vertex)] -= 100 * np.eye(3)
    blocks[LANES + 1, of_vertex] = 0.0
    with pytest.raises(NotPositiveDefinite) as caught:
        lockstep.factorise_batch(blocks)
    np.testing.assert_array_equal(np.flatnonzero(caught.value.members), [2, LANES + 1])


def test_lockstep_tells_a_matrix_that_is_not_finite(lockstep, pattern):
    blocks = np.stack([random_blocks(pattern)] * 3)
    blocks[1, lockstep.needed_slots[7], 1, 2] = np.nan
    with pytest.raises(SimulationError, match="matrix must be finite") as caught:
        lockstep.factorise_batch(blocks)
    assert not isinstance(caught.value, NotPositiveDefinite)


def test_only_needed_slots_are_read(backend, pattern):
    linear, right = solver(pattern, backend), right_side(pattern)
    blocks = random_blocks(pattern)
    expected = linear.factorise(blocks).solve(right)
    spoilt = np.full_like(blocks, np.nan)
    spoilt[linear.needed_slots] = blocks[linear.needed_slots]
    np.testing.assert_array_equal(linear.factorise(spoilt).solve(right), expected)


def test_default_needs_only_half_of_the_slots(default, pattern):
    assert len(default.needed_slots) == (pattern.slots + pattern.vertices) // 2


def test_every_needed_slot_matters(default, pattern):
    blocks, right = random_blocks(pattern), right_side(pattern)
    expected = default.factorise(blocks).solve(right)
    for slot in np.random.default_rng(1).choice(default.needed_slots, 20):
        changed = blocks.copy()
        changed[slot] += 1e-3 * np.eye(3)
        assert not np.array_equal(default.factorise(changed).solve(right), expected)


def test_bad_numbers_are_told(backend, pattern):
    linear = solver(pattern, backend)
    blocks = random_blocks(pattern)
    with pytest.raises(SimulationError, match="shape"):
        linear.factorise(blocks[:-1])
    with pytest.raises(SimulationError, match="shape"):
        linear.factorise_batch(blocks)
    factor = linear.factorise(blocks)
    for wrong in (np.ones((pattern.vertices, 2)), np.ones(3 * pattern.vertices)):
        with pytest.raises(SimulationError, match="right-hand side must have shape"):
            factor.solve(wrong)
    with pytest.raises(SimulationError, match="finite"):
        factor.solve(np.full((pattern.vertices, 3), np.nan))
    with pytest.raises(SimulationError, match="right-hand side must have shape"):
        linear.factorise_batch(np.stack([blocks, blocks])).solve(right_side(pattern, 3))
    for bad in (np.nan, np.inf):
        spoilt = blocks.copy()
        spoilt[linear.needed_slots[len(linear.needed_slots) // 2], 2, 1] = bad
        with pytest.raises(SimulationError, match="matrix must be finite") as caught:
            linear.factorise(spoilt)
        assert not isinstance(caught.value, NotPositiveDefinite)


def test_bad_patterns_are_told():
    points = np.zeros((2, 2))
    good = BlockPattern.from_couplings(points, np.array([[0, 1]]))
    with pytest.raises(SimulationError, match="symmetric"):
        BlockPattern(np.array([0, 2, 3]), np.array([0, 1, 1]), points)
    with pytest.raises(SimulationError, match="diagonal"):
        BlockPattern(np.array([0, 1, 2]), np.array([1, 0]), points)
    with pytest.raises(SimulationError, match="ascending"):
        BlockPattern(good.indptr, good.indices[[1, 0, 2, 3]], points)
    with pytest.raises(SimulationError, match="finite points"):
        BlockPattern(good.indptr, good.indices, np.full((2, 2), np.nan))
    with pytest.raises(SimulationError, match="finite points"):
        BlockPattern(good.indptr, good.indices, np.zeros((3, 2)))
    with pytest.raises(SimulationError, match="vertices 0 to 1, got 0 to 2"):
        BlockPattern.from_couplings(points, np.array([[0, 2]]))


def test_default_backend_is_ours(pattern):
    assert isinstance(solver(pattern), MultifrontalSolver)
    assert available_backends()[:3] == ["multifrontal", "lockstep", "splu"]


def test_unknown_and_missing_backends_are_told(pattern, monkeypatch):
    with pytest.raises(SimulationError, match="must be one of auto, multifrontal"):
        solver(pattern, "umfpack")
    monkeypatch.setattr("cusick_bench.sim.linear.interface.find_spec", lambda package: None)
    with pytest.raises(SimulationError, match="pip install pypardiso"):
        solver(pattern, "pardiso")


REPEAT = """
import sys, numpy as np
sys.path.insert(0, sys.argv[1])
from test_linear import cloth_pattern, random_blocks, right_side, solver
pattern = cloth_pattern(700)
factor = solver(pattern).factorise(random_blocks(pattern))
sys.stdout.write(factor.solve(right_side(pattern)).tobytes().hex())
"""


def test_default_gives_the_same_bits_whatever_the_threads(request, monkeypatch):
    """Other processes with one and with two threads: also shows that kernels cached on disk work elsewhere."""
    pattern = cloth_pattern(700)
    blocks, right = random_blocks(pattern), right_side(pattern)
    here = [solver(pattern).factorise(blocks).solve(right).tobytes().hex() for _ in range(2)]
    assert here[0] == here[1]
    for threads in ("1", "2"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
        command = [sys.executable, "-c", REPEAT, str(request.path.parent)]
        there = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert there == here[0]


def test_factor_keeps_its_panels_only(default, pattern):
    factor = default.factorise(random_blocks(pattern))
    panels = np.sum(default.tree.sizes[:, 0] * default.tree.sizes.sum(axis=1))
    assert factor.nbytes == 8 * panels


def test_blas_is_single_threaded_inside_and_put_back_after():
    if dense.THREAD_FUNCTIONS is None:
        pytest.skip("SciPy uses a BLAS whose threads we do not set")
    set_threads, get_threads = dense.THREAD_FUNCTIONS
    before = get_threads()
    set_threads(2)
    with dense.single_threaded():
        assert get_threads() == 1
    assert get_threads() == 2
    set_threads(before)


def test_any_blas_is_single_threaded_where_its_functions_cannot_be_seen(monkeypatch):
    """Those of OpenBLAS cannot on Windows, where it went on with all threads inside of the kernels' own."""
    monkeypatch.setattr(dense, "THREAD_FUNCTIONS", None)

    def threads() -> dict[str, int]:
        return {one["filepath"]: one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert max(before.values()) == 2
        with dense.single_threaded():
            assert set(threads().values()) == {1}
        assert threads() == before


def test_workspace_holds_few_updates_at_a_time(pattern):
    tree = analyse(pattern, dissect(pattern, 16), workers=1)
    assert tree.update_end < 0.4 * np.sum(tree.sizes[:, 1] ** 2)


def test_dissection_eliminates_every_vertex_once_and_keeps_pieces_apart():
    """No coupling joins two fronts unless one is above the other: the definition of a nested dissection."""
    pattern = cloth_pattern(800)
    dissection = dissect(pattern, 16)
    np.testing.assert_array_equal(np.sort(dissection.order), np.arange(800))
    front = np.empty(800, int)
    front[dissection.order] = np.repeat(np.arange(len(dissection.parent)), np.diff(dissection.start))
    low, high = np.sort([front[pattern.rows], front[pattern.indices]], axis=0)
    while (low < high).any():
        low = np.where(low < high, dissection.parent[low], low)
        assert (low >= 0).all()
    np.testing.assert_array_equal(low, high)


def test_fill_grows_like_n_log_n():
    """George (1973): the factor of a plane mesh has O(n log n) numbers; a bad order has O(n^1.5) or more."""
    sizes = np.array([500, 1000, 2000, 4000])
    numbers = []
    for vertices in sizes:
        pattern = cloth_pattern(int(vertices))
        numbers.append(MultifrontalSolver(pattern).tree.panel_start[-1])
    exponent = np.polyfit(np.log(sizes), np.log(np.array(numbers) / np.log(sizes)), 1)[0]
    assert exponent == pytest.approx(1.0, abs=0.15)
