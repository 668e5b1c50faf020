"""Cloths of triangles with hinges, as the laws `paper` and `published` have them.

placed_disc: meshes of cloth off the plate's axis; systems: their mechanics; internal_variables, history, contact: laws
that depend on hinges and faces; drop: their fall; cloths: all that together.
"""
