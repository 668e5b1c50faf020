"""Posterior over sets of effects that act together.

shared_causes: effects that all fabrics of a laboratory show; misfit: errors of the base model that are not due to an
effect; effect_points, point_likelihood: points of all grids in the rows of the misfit, and their likelihoods;
set_model: joint probability of a set; set_sampler: Gibbs sampler over sets; fabric_data, fabric_sets: the model and the
posterior of one fabric, with its base parameters; refined: parameters between grid points.
"""
