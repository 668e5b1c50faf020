"""Freed memory goes back to the system, although small blocks that live on lie between the freed ones."""

import ctypes
import subprocess
import sys
from types import SimpleNamespace

import pytest

from cusick_bench.sim import memory

GLIBC = sys.platform == "linux" and hasattr(ctypes.CDLL(None), "malloc_trim")
SCRIPT = """
import numpy as np
from cusick_bench.sim.memory import return_memory

def held():
    return int(open("/proc/self/statm").read().split()[1])

before, large, small = held(), [], []
for _ in range(2000):
    large.append(np.ones(12000))
    small.append(bytes(600))
grown = held() - before
large[0] = large  # refers to itself, so that only the collector finds it
del large
return_memory()
print((held() - before) / grown)
"""


@pytest.mark.skipif(not GLIBC, reason="malloc_trim is of glibc")
def test_freed_memory_is_returned():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 0.3


@pytest.mark.parametrize(("seconds", "returned"), [(0.5, 0), (2.0, 1)])
def test_memory_is_returned_after_long_work_also_where_that_fails(monkeypatch, seconds, returned):
    calls, clock = [], iter([10.0, 10.0 + seconds])
    monkeypatch.setattr(memory, "return_memory", lambda: calls.append(1))
    monkeypatch.setattr(memory, "time", SimpleNamespace(monotonic=lambda: next(clock)))

    @memory.memory_returned()
    def work():
        raise ValueError("failed")

    with pytest.raises(ValueError, match="failed"):
        work()
    assert len(calls) == returned
