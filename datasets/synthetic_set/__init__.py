"""How the shipped synthetic set was made.

recipe: cloths and drapes with known parameters; files: writes them in the public layout.
"""
