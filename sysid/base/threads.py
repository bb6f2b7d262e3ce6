"""One BLAS thread inside a fit.

Several BLAS threads add in another order, which changes the last digits; the matrices are small and gain nothing from
threads.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import RLock

from threadpoolctl import ThreadpoolController

_LOCK = RLock()
_depth = 0


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within this context every BLAS call uses one thread; may be nested, and entered from several threads."""
    global _depth
    with _LOCK:
        if _depth == 0:
            _limits.append(_controller().limit(limits=1, user_api="blas"))
        _depth += 1
    try:
        yield
    finally:
        with _LOCK:
            _depth -= 1
            if _depth == 0:
                _limits.pop().restore_original_limits()


_limits: list = []


def available() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
