"""The compiled engine: forces of a cloth on its support, and two ways from them to a drape.

system: `DrapeSystem`, forces, stiffness and adjoint; elements, layout, assembly, workspace and the three kernel files:
its parts; parameters: the cloth's numbers; settings: `DrapeSettings`; drop: implicit Euler; drop_batch: drops of many
cloths, with shorter steps where they fly apart; descent, equilibrium: Newton's method; branch: which rest was followed;
force_basis, force_modes: forces as linear functions of stiffness tables and of random fields.
"""

NUMERICS_VERSION = 2  # raised when a mesh's or a drape's numbers change: see runner/numerics.py
