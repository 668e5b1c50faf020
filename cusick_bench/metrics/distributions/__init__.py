"""Predicted drapes against those of samples, as distributions.

energy, proper_scores: scores of all draws together; calibration: whether samples rank among them; classification:
whether they are taken for their own cloth; statistics: the numbers that describe a drape; distribution: all of these
in one table; drape_variability: how much drapes differ among themselves.
"""
