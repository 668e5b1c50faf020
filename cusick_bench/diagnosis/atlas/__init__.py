"""The atlas: features of simulated fabrics with and without each effect, as smooth functions.

base_model: drapes without effects; design: what an atlas is made of; drapes: makes it; points: its files; observation:
what a camera sees of drapes; emulator, response: the functions; emulator_fit: their fit to the points, with ridge and
regression_terms; response_check: what the functions leave unexplained; store: the shipped file and its calibration.
"""
