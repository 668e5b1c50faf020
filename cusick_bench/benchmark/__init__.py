"""How fast, how lean and how exact the simulator is: measured in one run, side by side with what it is compared to.

convergence: how far drapes depend on mesh and time step.
"""
