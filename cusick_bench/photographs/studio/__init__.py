"""Synthetic photographs of drapes: light, shadow, texture and lens are drawn, the true outline is known.

Nothing here but the printed board is shared with the code that reads photographs, so that neither can hide the other's
mistakes.
"""
