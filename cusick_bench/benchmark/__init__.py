"""How fast, how lean and how exact the simulator is: measured in one run, side by side with what it is compared to.

suite, plan, targets, text: the whole benchmark, what it measures and has to reach, and its text; convergence: how far
drapes depend on mesh and time step; fold_selection: what decides number and depth of folds; optimisers: gradient-free
solvers on published test functions; posterior_calibration: whether intervals of stiffness hold the truth as often as
they say.
"""
