"""From silhouettes to statistics, and distances of their distributions.

captures: profiles of one fabric; statistics: one vector per capture; features: their means, scatter and drift;
energy, floors, gap: the gap between data and model; resampling: tests and intervals over samples.
"""
