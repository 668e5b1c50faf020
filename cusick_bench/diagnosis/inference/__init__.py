"""Which effects explain a fabric's features, together.

residuals: what the best base model leaves of a fabric's features, in units of noise; single_effects: each effect alone
on a grid, and what follows from that; sets: posterior over sets of effects; findings: the verdict, shares of the gap
and parameters that it amounts to; fabric_evidence: all of that for one fabric; laboratory: what all fabrics of a data
set share; detectability: how strong and how distinct effects must be to be found.
"""
