"""The Hessian of a cloth in contact, on a sparsity pattern that follows the contacts.

Contacts couple vertices that are far apart in the cloth, so its fixed pattern can't hold them. The pattern here joins
the cloth's couplings with those of all parts that are near contact; it is analysed again only when a contact outgrows
it. Until something touches, it is the cloth's own pattern and solver.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.contact.barrier import ContactForces
from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.linear.interface import BLOCK, BlockPattern, Factor, LinearSolver, solver

_MARGIN = 1.5
"""Reach of the pattern in thicknesses. Measured on drapes of 600 and 1205 vertices: 1 analyses twice as often; 3 and 6
save few analyses and their larger factors take longer in all."""


class ContactMatrix:
    """Adds, regularises and factorises the Hessians of cloth and contacts; keeps the analysed pattern between calls."""

    def __init__(self, system: ClothSystem) -> None:
        self.system = system
        self._rows = len(system.free)
        self._row_of = np.full(system.mesh.vertices, -1)
        self._row_of[system.free] = np.arange(self._rows)
        layout = system.layout
        row = np.repeat(np.arange(self._rows), np.diff(layout.indptr))
        self._cloth_keys = row * self._rows + layout.indices
        # The cloth fills a triangle or more of its blocks; every block is read from the filled one of its two places.
        filled = np.zeros(len(layout.indices), bool)
        filled[system.linear.needed_slots] = True
        mirror = np.searchsorted(self._cloth_keys, layout.indices * self._rows + row)
        self._source = np.where(filled, np.arange(len(filled)), mirror)
        self._transposed = ~filled
        self._adopt(self._cloth_keys, system.linear)

    def _adopt(self, keys: Int[ndarray, " slots"], linear: LinearSolver) -> None:
        self._keys, self._linear = keys, linear
        self._cloth_slots = np.searchsorted(keys, self._cloth_keys)
        row, column = np.divmod(keys, self._rows)
        self._diagonal = np.flatnonzero(row == column)

    def blocks(
        self, cloth: Float[ndarray, "cloth_slots 3 3"], contacts: ContactForces, *, project: bool
    ) -> Float[ndarray, "slots 3 3"]:
        """Hessian of the free vertices.

        Args:
            cloth: Blocks of the cloth alone, in its layout's slots.
            contacts: The contacts at the same configuration.
            project: Take only the positive-semidefinite part of every contact's Hessian.

        Returns:
            Blocks in the slots of the present pattern, which grows with what comes near contact.
        """
        keys, values = self._contact_blocks(contacts, project=project)
        if not np.isin(keys, self._keys, assume_unique=True).all():
            self._follow(contacts)
        whole = cloth[self._source]
        whole[self._transposed] = whole[self._transposed].transpose(0, 2, 1)
        blocks = np.zeros((len(self._keys), BLOCK, BLOCK))
        blocks[self._cloth_slots] = whole
        blocks[np.searchsorted(self._keys, keys)] += values
        return blocks

    def factorise(self, blocks: Float[ndarray, "slots 3 3"], added: Float[ndarray, " rows"]) -> Factor:
        """Factor of the Hessian plus added[i] times the identity at every free vertex i.

        Args:
            blocks: As `blocks` returned them last [N/m].
            added: One number for each free vertex [N/m].

        Returns:
            The factor.

        Raises:
            NotPositiveDefinite: The sum is not positive definite.
        """
        regularised = blocks.copy()
        for axis in range(BLOCK):
            regularised[self._diagonal, axis, axis] += added
        return self._linear.factorise(regularised)

    def _contact_blocks(
        self, contacts: ContactForces, *, project: bool
    ) -> tuple[Int[ndarray, " contact_slots"], Float[ndarray, "contact_slots 3 3"]]:
        """Blocks between free vertices, with the keys of their places, ascending."""
        if contacts.count == 0:
            return np.empty(0, np.int64), np.empty((0, BLOCK, BLOCK))
        matrix = sparse.bsr_array(contacts.hessian(project=project), blocksize=(BLOCK, BLOCK))
        row = self._row_of[np.repeat(np.arange(self.system.mesh.vertices), np.diff(matrix.indptr))]
        column = self._row_of[matrix.indices]
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        keys = row[kept] * self._rows + column[kept]
        order = np.argsort(keys, kind="stable")
        return keys[order], matrix.data[kept[order]]

    def _follow(self, contacts: ContactForces) -> None:
        """Takes the pattern of the cloth and of what is near contact now."""
        contact = contacts.contact
        near = self._row_of[contact.couplings(contacts.x, _MARGIN * contact.thickness)]
        now = self._row_of[contacts.couplings()]
        near = np.concatenate([near, now])
        near = near[(near >= 0).all(1)]
        cloth = np.column_stack(np.divmod(self._cloth_keys, self._rows))
        points = self.system.mesh.material[self.system.free]
        pattern = BlockPattern.from_couplings(points, np.concatenate([cloth, near]))
        self._adopt(pattern.rows * self._rows + pattern.indices, solver(pattern, self.system.backend))
