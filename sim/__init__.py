"""Differentiable simulator of the Cusick drape test: mesh -> material -> drape -> camera -> silhouette."""

from typing import Any

from numba.core import config

_configuration: Any = config
if _configuration.THREADING_LAYER == "default":
    # Its idle threads sleep, whereas GNU OpenMP's spin and lose most of the gain on a busy machine; and OpenMP
    # aborts a process pool that forks. Set NUMBA_THREADING_LAYER to choose otherwise.
    _configuration.THREADING_LAYER = "workqueue"
