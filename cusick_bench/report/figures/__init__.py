"""The paper's figures, of a results folder.

predictions: what cells predict, beside the data; radius_angle, side_by_side, fold_variability, anytime: the figures;
sheet: axes side by side.
"""

SHOWN_SAMPLES = 3  # held-out samples of a cloth in figure 6
CLASSIFIED_DRAWS = 200  # of a cell in figure 7, evenly spaced
