"""Solvers: methods that answer a drape problem, and the reference rows they are read against."""
