"""Gradient-free search in a box.

box: base class of these methods; sobol, cmaes, nlopt_family: methods.
"""
