"""Diagnosis of the gap between real and simulated drapes: where it lies, what causes it, how far it shrinks."""
