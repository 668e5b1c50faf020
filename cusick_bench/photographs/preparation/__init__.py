"""From a folder of photographs to a data set in the project's layout.

prepare: the whole procedure; pictures: what each file shows; calibrate: the camera, from the pictures that there are;
on_axis, reading_on_axis: the outline seen from the plate's axis; silhouette: images; setting_text, weights, quantities:
descriptions and numbers with units; whole_folder: a folder that appears complete.
"""
