"""Self-contact: a barrier keeps parts of the cloth apart, during a drop and at rest.

barrier: `SelfContact`; matrix: the Hessian with contacts; drop, equilibrium: both ways to a drape with contacts;
intersections: whether a cloth passes through itself.
"""

NUMERICS_VERSION = 1  # raised when drapes with self-contact change: see runner/numerics.py
