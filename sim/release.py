"""Release of a cloth: the drop of the diagnosis' base model, and of the study of what decides the folds.

The folds of a drape are decided by the stiffness of the cloth, by the shape in which it is laid down, and by whether it
falls or is let down slowly (`cusick-bench fold-selection`, `docs/folds.md`). The release is always a fall, since a
slower release changes the number of folds in the same way as a longer laid shape.
"""

STEP_SECONDS = 0.05  # [s] of the drop, implicit Euler
STEPS = 90  # of a drop, 4.5 s in all
