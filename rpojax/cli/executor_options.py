"""Options of commands that say which processes simulate the blocks of a campaign."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax.errors import RpojaxError

if TYPE_CHECKING:
    from rpojax.campaign.execution.executor import Executor
    from rpojax.campaign.storage.campaign_folder import Campaign


ShardText = Annotated[
    str | None,
    arg(metavar="I/N", help="Only the blocks b with b % N == I - 1, into a folder shared with the other shards."),
]


WorkerCount = Annotated[
    int | None, arg(metavar="N", help="Number of worker processes; the crash of one does not affect the others.")
]


ExecutorName = Annotated[str, arg(metavar="KIND", help="Executor of the blocks: 'local', or 'dask' for a cluster.")]


Scheduler = Annotated[str | None, arg(metavar="ADDRESS", help="Address of the running Dask scheduler.")]


def check_executor(executor: str, scheduler: str | None, workers: int | None, shard: str | None, force: bool) -> None:
    """Raises on options that contradict each other, before any work."""
    if executor not in ("local", "dask"):
        raise RpojaxError(f"--executor: found {executor!r}, expected 'local' or 'dask'")
    if (executor == "dask") != (scheduler is not None):
        found = f"--executor {executor} and {'no' if scheduler is None else 'a'} --scheduler"
        raise RpojaxError(f"--scheduler: found {found}, expected it with --executor dask and only there")
    if workers is not None and (workers < 1 or executor == "dask"):
        raise RpojaxError(f"--workers: found {workers}, expected at least 1, and --executor local")
    if shard is not None and force:
        raise RpojaxError("--force: found it with --shard, expected it without: a shard joins the folder of the others")


def make_executor(name: str, scheduler: str | None, workers: int | None) -> "Callable[[Campaign], Executor] | None":
    """Executor factory for the options, or None for this process."""
    if name == "dask":
        from rpojax.campaign.execution.dask_executor import DaskExecutor

        return lambda result: DaskExecutor(result, scheduler or "")
    if workers is not None:
        from rpojax.campaign.execution.process_executor import ProcessExecutor

        return lambda result: ProcessExecutor(result, workers)
    return None
