"""Long work in a separate thread, so that an interrupt takes effect at once."""

import os
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rpojax.campaign.storage.campaign_folder import Campaign

from rpojax.runtime.progress_bar import ProgressCallback, run_progress

_WORKER = "rpojax-worker"
Result = TypeVar("Result")


def with_progress(work: "Callable[[ProgressCallback], Campaign]", duration_s: float, as_json: bool) -> "Campaign":
    """Result of `work(on_progress)` with a progress display; an interrupt takes effect even while compiling."""
    with run_progress(duration_s, quiet=as_json) as watch:
        return interruptible(lambda: work(watch))


def interruptible(work: Callable[[], Result]) -> Result:
    """Result of `work()`, done in another thread, so that an interrupt reaches this one whatever the work is about."""
    results: list[Result] = []
    errors: list[BaseException] = []

    def target() -> None:
        try:
            results.append(work())
        except BaseException as error:
            errors.append(error)

    worker = threading.Thread(target=target, name=_WORKER, daemon=True)
    worker.start()
    worker.join()
    if errors:
        raise errors[0]
    return results[0]


def abandon_worker(status: int) -> None:
    """Ends the process if a worker is still running; a normal exit would wait for the compiler, or crash in it."""
    if any(thread.name == _WORKER for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
