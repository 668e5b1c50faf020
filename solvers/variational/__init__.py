"""Variational inference: a Gaussian over stiffness, learned from one silhouette.

bdp: the paper's, per element; bdp_field: over smooth random fields;
gaussian_posterior, cloth_inference, linear_correction, slice_sampling, predictive: their parts.
"""
