"""Synthetic photographs of drapes: light, shadow, texture and lens are drawn, the true outline is known.

scene: laboratories and drapes, made from a number; lens, raster, shadow, pattern: parts of the picture; shot: takes it;
trouble: spoils it; truth: the outline; folder: writes all of it.

Nothing here but the printed board is shared with the code that reads photographs, so that neither can hide the other's
mistakes.
"""
