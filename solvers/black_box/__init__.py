"""Gradient-free search in a box.

box: what such a method is; sobol, cmaes, nlopt_family: methods.
"""
