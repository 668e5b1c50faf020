"""Photographs of drapes: from phone pictures to silhouettes in the layout of a data set.

reading: `Photograph`; board, sheet: the printed board; calibration: the camera over the plate; segmentation: the
cloth's outline and its confidence; preparation: from a folder of photographs to a data set; studio: synthetic
photographs whose outline is known; accuracy: errors of outlines on these. All raise `BadPhotograph` (errors).
"""

NUMERICS_VERSION = 4  # raised when outlines, silhouettes or their confidence change: see runner/numerics.py
