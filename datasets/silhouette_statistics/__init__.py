"""The vocabulary of silhouette statistics.

definitions: each statistic, defined once, by name; selections: `Selection`, and the vectors `SCORED`, `DIAGNOSED` and
`INFERRED` that other parts of the project use.
"""
