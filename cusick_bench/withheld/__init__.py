"""Withheld cases: drapes whose unmodelled effect is sealed, made, answered and scored."""

NUMERICS_VERSION = 6  # raised when a case's or a score's numbers change: see runner/numerics.py
