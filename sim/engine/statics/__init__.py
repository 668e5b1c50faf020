"""A drape as static equilibrium.

descent: Newton's method on an energy; equilibrium: rests and their derivatives; branch: which rest was followed.
"""
