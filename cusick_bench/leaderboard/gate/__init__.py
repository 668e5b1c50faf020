"""The regression gate: has a solver become worse than a committed baseline?

baseline: tables to compare; paired: the test; check: its verdict; junit: the same as XML.
"""
