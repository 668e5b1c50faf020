"""Settings of the process while solvers work, put back after the last of them."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout


class _Working:
    """Number of solvers that work in this process, and what is to be put back after the last of them."""

    count = 0
    settings = ExitStack()


@contextmanager
def settings_of_work() -> Iterator[None]:
    """One thread for BLAS, and standard error for what is printed, until no solver of any thread works any more.

    BLAS splits long sums by its number of threads, and a fit amplifies the differences in the last digit. Both settings
    are the process's: a solver that put back what it found would put back for good what another thread's had set.

    Yields:
        Nothing; the settings are made.
    """
    from threadpoolctl import threadpool_limits

    from cusick_bench.sim.threads import alone

    with alone():  # a simulation sets the threads of BLAS, too
        _take_blas()
        _Working.settings.enter_context(threadpool_limits(limits=1, user_api="blas"))
        _Working.settings.enter_context(redirect_stdout(sys.stderr))
        _Working.count += 1
    try:
        yield
    finally:
        with alone():
            _Working.count -= 1
            if not _Working.count:
                _take_blas()
                _Working.settings.close()
                _take_blas()


def _take_blas() -> None:
    """Lets any thread set those of OpenBLAS; threadpoolctl 3.8 hears only the first that does, as long as it lives."""
    import threadpoolctl

    controller = getattr(threadpoolctl, "OpenBLASController", None)
    release = getattr(controller, "clear_controlling_thread", None)
    if release is not None:
        release(force=True)
