"""In what cloths differ, learned from fabrics that no table predicts.

expected_statistics: statistics of a cloth's drapes, and their scatter over specimens, as regressed; derivation: the
priors of the field space; levels: simulated samples beside real ones.
"""
