"""Who runs the cells of a grid.

executor: what all of them are to their caller; pool: processes of this machine, or an executor that is lent; submitted:
tasks of a cluster; turns: the order of cells, in which those that another process runs come last.
"""
