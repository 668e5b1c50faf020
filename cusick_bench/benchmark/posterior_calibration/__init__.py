"""Simulation-based calibration of solvers that give a posterior.

calibration: fits of drapes whose stiffness is known, and ranks of the truth; table: finished fits, and what is made of
them.
"""
