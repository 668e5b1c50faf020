"""From silhouettes to statistics, and distances between their distributions.

captures: profiles of one fabric; statistics: one vector per capture; features: their means, scatter and drift; floors,
gap: the gap between data and model; own_outlines: effects that act on the outline alone; resampling: tests and
intervals over samples.
"""
