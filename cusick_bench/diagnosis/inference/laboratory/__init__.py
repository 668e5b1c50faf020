"""Effects of the laboratory, which all fabrics of a data set share.

shared_effects: effects that may be shared, and what is found of them; shared_walk: sampler of the shared set and of
each fabric's own; laboratory: both for a data set.
"""
