"""The torch engine: whole batches of drops on a GPU (or on the CPU), with exact adjoint gradients.

engine: `TorchEngine`, what `DrapeSimulator` calls; drop, rollout: batches and their adjoint; forces, laws, gather: one
step of laws `paper` and `published`; shell_forces, plate, shell_maps: of law `plate`; batch_forces: what both offer;
multifrontal, fronts: batched factorisations; small_products, replay: what a GPU needs to be fast.
"""
