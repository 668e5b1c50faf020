"""Differentiable simulator of the Cusick drape test: mesh -> material -> drape -> camera -> silhouette."""

from cusick_bench.sim.kernel_cache import keep_by_content
from cusick_bench.sim.threads import configure

keep_by_content()
configure()
