"""Which effects explain a fabric's features, together.

samples, feature_rows, fabric_data: what is known of a fabric; residual: what the best base model leaves; hypotheses,
evidence: effects on a grid; misfit: what the base model may get wrong; effect_points, point_likelihood, set_model,
set_sampler, fabric_sets: posterior over sets of effects; detection, novelty, verdict, refusal: what it amounts to;
refined, intervals, budget: parameters and shares of the gap; laboratory: what all fabrics of a data set share;
fabric_evidence: all of that for one fabric; equivalents, localise, next_measurement: what follows from it; baselines:
simpler methods; power, separation: detectable shifts, and how far effects lie apart.
"""
