"""Where the cloth ends: ground and cloth told apart in the plane of the plate, with a confidence.

outline: `find_outline`, by these steps. polar: the picture about the plate's axis; shading: even light; colour, edge:
evidence of places; path: the best closed path; snap, refine: places at and between pixels; profiles, edge_model: what
the network reads from the light across it, and the error it expects; confidence: what speaks against it.
"""
