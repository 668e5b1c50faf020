"""Posterior over sets of effects that act together.

misfit: what the base model may get wrong by itself; effect_points, point_likelihood: points of all grids in the rows of
the misfit, and their likelihoods; set_model: joint probability of a set; set_sampler: Gibbs sampler over sets;
fabric_data, fabric_sets: both for one fabric, with its base parameters; refined: parameters between grid points.
"""
