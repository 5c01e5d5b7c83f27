"""Options of commands that say which processes simulate the blocks of a campaign."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax.errors import RpojaxError

if TYPE_CHECKING:
    from rpojax.campaign.execution.executor import Executor
    from rpojax.campaign.options.campaign_options import Shard
    from rpojax.campaign.storage.campaign_folder import Campaign


@dataclass(frozen=True)
class ExecutorOptions:
    """Which processes simulate the blocks of a campaign."""

    shard: Annotated[
        str | None,
        arg(metavar="I/N", help="Only the blocks b with b % N == I - 1, into a folder shared with the other shards."),
    ] = None
    workers: Annotated[
        int | None, arg(metavar="N", help="Number of worker processes; the crash of one does not affect the others.")
    ] = None
    executor: Annotated[str, arg(metavar="KIND", help="Executor of the blocks: 'local', or 'dask' for a cluster.")] = (
        "local"
    )
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help="Address of the running Dask scheduler.")] = None

    def check(self, force: bool = False) -> None:
        """Raises on options that contradict each other, before any work.

        Raises:
            RpojaxError: naming the option.
        """
        if self.executor not in ("local", "dask"):
            raise RpojaxError.of_argument("executor", f"found {self.executor!r}, expected 'local' or 'dask'")
        if (self.executor == "dask") != (self.scheduler is not None):
            found = f"--executor {self.executor} and {'no' if self.scheduler is None else 'a'} --scheduler"
            raise RpojaxError.of_argument(
                "scheduler", f"found {found}, expected it with --executor dask and only there"
            )
        if self.workers is not None and (self.workers < 1 or self.executor == "dask"):
            raise RpojaxError.of_argument("workers", f"found {self.workers}, expected at least 1, and --executor local")
        if self.shard is not None and force:
            raise RpojaxError.of_argument(
                "force", "found it with --shard, expected it without: a shard joins the folder of the others"
            )

    def refuse_other_processes(self) -> None:
        """Raises on any option, where work goes on in this process alone.

        Raises:
            RpojaxError: naming the option.
        """
        for name in ("shard", "workers", "scheduler"):
            if getattr(self, name) is not None:
                raise RpojaxError.of_argument(
                    name, "found it with an estimate of a probability, expected it with a campaign"
                )

    def parse_shard(self) -> "Shard | None":
        """The shard, None for all blocks.

        Raises:
            RpojaxError: the text has another form, or there is no such shard.
        """
        from rpojax.campaign.options.campaign_options import Shard

        return None if self.shard is None else Shard.parse(self.shard)

    def executor_factory(self) -> "Callable[[Campaign], Executor] | None":
        """Maker of the executor, None for this process."""
        if self.executor == "dask":
            from rpojax.campaign.execution.dask_executor import DaskExecutor

            return lambda result: DaskExecutor(result, self.scheduler or "")
        if self.workers is not None:
            from rpojax.campaign.execution.process_executor import ProcessExecutor

            workers = self.workers
            return lambda result: ProcessExecutor(result, workers)
        return None
