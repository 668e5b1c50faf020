"""Where the cloth ends: ground and cloth told apart in the plane of the plate, with a confidence.

outline: `find_outline`, by these steps. polar: the picture about the plate's axis; shading: even light; colour, edge:
evidence of places; path: the best closed path; refine: places between pixels; confidence: what speaks against it.
"""
