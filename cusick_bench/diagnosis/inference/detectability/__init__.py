"""What can be found at all, from the atlas alone.

power: how strong an effect must be; separation: how far effects lie apart, and by which statistics.
"""
