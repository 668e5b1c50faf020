"""Which effect explains a fabric's features.

residual: what the best base model leaves; hypotheses: effects on a grid; evidence: marginal likelihoods;
fabric_evidence: all of that for one fabric; verdict: what probabilities amount to; pairs, stepwise, equivalents,
localise, next_measurement: what follows from it; baselines: simpler methods; power: detectable shifts.
"""
