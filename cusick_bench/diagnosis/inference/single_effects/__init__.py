"""Each effect alone, over all its severities, directions and places.

hypotheses: shifts of the features by every effect; evidence: how well each explains a residual; finer: grids with finer
steps about some points; equivalents: causes that no silhouette tells apart; localise: where on the cloth a local cause
acts; next_measurement: measurements that would tell causes apart; baselines: simpler methods, for comparison.
"""
