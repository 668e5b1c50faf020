"""Verification: a row is *reported* until its cells have been repeated, and then *verified*.

comparison: tolerances; resimulate: one cell repeated; verify: a whole run; tracks, submit: its rows for a committed
table.
"""
