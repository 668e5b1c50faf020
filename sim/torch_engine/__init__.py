"""The torch engine: whole batches of drops on a GPU (or on the CPU), with exact adjoint gradients.

engine: `TorchEngine`, what `DrapeSimulator` calls; drop, rollout: batches and their adjoint; forces, laws, gather: one
step; linear, fronts, cudss: batched factorisations.
"""
