"""Rows to read results against: predictors without physics, and predictors that see the held-out images.

null: `null:*`; oracle: `oracle:*`; silhouettes: pictures drawn from radius profiles.
"""
