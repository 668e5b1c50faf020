"""Differentiable simulator of the Cusick drape test: mesh -> material -> drape -> camera -> silhouette."""

from cusick_bench.sim.openmp import load_openmp

load_openmp()  # before torch loads it
