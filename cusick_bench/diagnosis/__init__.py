"""Diagnosis of the gap between real and simulated drapes: where it lies, what causes it, how far it shrinks."""

NUMERICS_VERSION = 16  # raised when a diagnosis's numbers change: see runner/numerics.py
