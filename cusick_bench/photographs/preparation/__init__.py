"""From a folder of photographs to a data set in the project's layout.

prepare: the whole way; pictures: which file shows what; calibrate: the camera from what there is; on_axis,
reading_on_axis: the outline seen from the plate's axis; silhouette: images; weights, quantities: numbers with units.
"""
