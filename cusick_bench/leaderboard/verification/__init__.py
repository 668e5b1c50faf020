"""From reported to verified.

resimulate: one cell done again; verify: a whole run; submit: its rows for a committed table.
"""
