"""Stiffness from three-dimensional shapes by convex optimisation.

equilibrium_gap: the solver; force_balance: its convex problem.
"""
