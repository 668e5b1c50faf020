"""The simulator in plain torch autograd: slow and readable; the engines are tested and benchmarked against it.

laws: `Reference`, forces of laws `paper` and `published`; plate: `PlateReference`, law `plate`; tables: how they read
the stiffness tables; drop: `drop_reference`.
"""
