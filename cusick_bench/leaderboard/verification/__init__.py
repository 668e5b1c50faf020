"""From reported to verified.

comparison: what may differ by how much; resimulate: one cell done again; verify: a whole run;
submit: its rows for a committed table.
"""
