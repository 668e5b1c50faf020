"""The compiled engine: forces of a cloth on its support, and two ways from them to a drape.

parameters: the cloth's numbers; triangles: forces of laws with hinges; plate: forces of law `plate`; cloth_system: the
common interface of both; settings: `DrapeSettings`; pace: steady and brisk drops; dynamics: the drop, by implicit
Euler; statics: the equilibrium, by Newton's method; strains: bending and shear for laws with internal variables.
"""

NUMERICS_VERSION = 2  # raised when a mesh's or a drape's numbers change: see runner/numerics.py
