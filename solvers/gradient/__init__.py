"""Deterministic fits by gradients.

homo: one stretch and one bending table; heter: tables per element, with gauss_newton, blurred_misfit and smooth_field.
"""
