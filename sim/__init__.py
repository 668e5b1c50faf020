"""Differentiable simulator of the Cusick drape test: mesh -> material -> drape -> camera -> silhouette."""

from cusick_bench.sim.kernel_cache import keep_by_content
from cusick_bench.sim.threads import load_openmp

keep_by_content()  # before any kernel is defined
load_openmp()  # before torch loads it
