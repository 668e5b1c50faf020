"""Diagnosis by simulation, beyond the atlas.

samples: statistics of simulated samples; closure: how far causes close the gap on samples that they were not fitted to.
"""
