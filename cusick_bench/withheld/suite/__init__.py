"""Making a suite of withheld cases.

design: which cases; detectable: how strong effects must be; generate: writes cases and labels; labels: their contents.
"""
