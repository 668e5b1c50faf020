"""What decides number and depth of a drape's folds: the cloth, how it is laid down and released, or the mesh.

conditions: ways to make a drape, and which of them are compared; responses: what is measured on sets of drapes;
study: drapes each condition; real_cloth: the same numbers of real cloths.
"""
