"""Synthetic photographs of drapes: light, shadow, texture and lens are drawn, the true outline is known.

scene: laboratories and drapes from a seed; lens, raster, shadow, pattern: parts of the picture; shot: draws it;
trouble: disturbances; truth: the true outline; folder: writes all files.

Apart from the printed board nothing is shared with the code that reads photographs, so that a mistake in one cannot be
hidden by the other.
"""
