"""The simulator in plain torch autograd: slow and readable, what the engines are checked and measured against.

laws: `Reference`, forces of laws `paper` and `published`; plate: `PlateReference`, law `plate`; tables: how they read
the stiffness tables; drop: `drop_reference`.
"""
