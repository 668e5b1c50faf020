"""Diagnosis by simulation, beyond the atlas.

samples: statistics of simulated samples; closure: how far a cause closes the gap on samples it has not seen.
"""
