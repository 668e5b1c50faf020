"""Stiffness from the three-dimensional shape of a drape by convex optimisation.

equilibrium_gap: the solver; force_balance: its convex problem.
"""
