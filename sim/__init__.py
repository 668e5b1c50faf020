"""Differentiable simulator of the Cusick drape test: mesh -> material -> drape -> camera -> silhouette."""

from cusick_bench.sim.threads import configure

configure()
