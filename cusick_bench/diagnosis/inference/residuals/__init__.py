"""The residual of a fabric's features after the best fit of the base parameters, in units of noise.

samples: statistics of its samples; feature_rows: rows of its feature vector; noise: their covariance; residual: the
whitened difference to the base model; refusal: data that cannot be diagnosed, or only in part.
"""
