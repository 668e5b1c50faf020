"""Where the plate is, seen from the camera: from pictures of the printed board or of the bare plate.

view: `PlateView`, the calibrated camera; boards: Zhang's method on pictures of the board; plate: the plate's circle.
"""
