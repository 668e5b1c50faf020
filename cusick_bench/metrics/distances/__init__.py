"""Distances between two drapes.

image, profile, hausdorff_distance: distances of silhouettes, of outlines and of surfaces in space; surface, ruled: the
surfaces; shape: a drape in all the forms in which it is compared.
"""
