"""A fabric against the base model: what is left when the base parameters have done their best, in units of noise.

samples: statistics of its samples; feature_rows: rows of its feature vector; noise: how they scatter; residual: what
the base model leaves of them; refusal: data that cannot be diagnosed, or in part only.
"""
