"""The compiled engine: forces of a cloth on its support, and two ways from them to a drape.

parameters: the cloth's numbers; triangles: forces of laws with hinges; plate: those of law `plate`; cloth_system:
either; settings: `DrapeSettings`; dynamics: the drop, by implicit Euler; statics: the rest, by Newton's method;
strains: as laws with internal variables see them.
"""

NUMERICS_VERSION = 2  # raised when a mesh's or a drape's numbers change: see runner/numerics.py
