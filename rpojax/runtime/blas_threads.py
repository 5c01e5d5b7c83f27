"""Number of threads of the linear algebra library (BLAS) of this process."""

import contextlib
import os
from collections.abc import Iterator


def start_with_one_thread() -> None:
    """Has OpenBLAS start with one thread, unless the user has set another number. Call it before NumPy is imported."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Context in which BLAS uses one thread, for small matrices: more threads would wait for each other."""
    # Imported here, because it sets a variable of its own (KMP_DUPLICATE_LIB_OK).
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
