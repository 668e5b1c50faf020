"""Segmentation of cloth and ground in the plane of the plate: the cloth's outline and its confidence.

outline: `find_outline`, with these steps. polar: the picture in polar coordinates; shading: correction of uneven light;
colour, edge: evidence for cloth, ground and edges; path: the best closed path; snap, refine: the outline at and between
pixels; profiles, edge_model: a network that reads the outline from the light across it, with its expected error;
confidence: a score of the outline.
"""
