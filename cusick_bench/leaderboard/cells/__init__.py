"""Finished cells of a results folder: what all tables are made of.

loading: the cells as one table; record_types, plausible: what a cell must say to be in it; cell_number: how cells are
numbered; variants: which of them make one row; source: the data that they were run on; commands: which commands made
them.
"""
