"""Bayesian optimisation, on BoTorch.

search: design, model, acquisition, again and again; gaussian_process, embedding, trust_region: its parts;
rembo, hesbo, turbo, baxus, vanilla_bo: methods.
"""
