"""The paper's figures, of a results folder.

predictions: what cells predict, beside the data; radius_angle, side_by_side, fold_variability, anytime: the figures;
sheet: axes side by side.
"""
