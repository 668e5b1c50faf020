"""A drape by dropping the cloth from the shape in which it is laid down.

drop: linearly implicit Euler and its adjoint; drop_batch: drops of many cloths, with shorter steps where they fly
apart; step_kernels: vector operations of a step.
"""
