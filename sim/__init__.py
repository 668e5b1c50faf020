"""Differentiable simulator of the Cusick drape test: mesh -> material -> drape -> camera -> silhouette."""
