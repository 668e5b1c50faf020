"""The atlas: features of simulated fabrics with and without each effect, as smooth functions.

base_model: drapes without effects; drapes: makes the atlas' simulations; emulator, response: functions fitted to them,
with ridge and regression_terms; effect_timing: when effects act; response_check: what the functions leave unexplained;
store: the shipped file and its calibration.
"""
