"""Executor that simulates blocks on a Dask cluster, whose workers see the campaign folder under the same path."""

import functools
import threading
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from rpojax.campaign.execution import block_runner, campaign_engine
from rpojax.campaign.execution.executor import MAX_ATTEMPTS, ExecutorProgressCallback, check_default_stages
from rpojax.campaign.storage import campaign_configuration
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.optional_packages import require_package
from rpojax.runtime import jax_configuration

_LOCK = threading.Lock()
"""Held while a block is simulated: the threads of a Dask worker take turns."""


@dataclass(frozen=True)
class DaskExecutor:
    """Submits one task per block to a Dask scheduler.

    Attributes:
        campaign: where results are stored
        scheduler: address, such as `tcp://10.0.0.1:8786`
    """

    campaign: Campaign
    scheduler: str

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Simulates some blocks; Dask repeats those whose worker died, within its limit `allowed-failures`."""
        check_default_stages(self.campaign)
        if self.campaign.file.plugin is not None:
            raise RpojaxError(f"plugin: found {self.campaign.file.plugin!r}, expected none with workers of a cluster")
        distributed = require_package("distributed")
        on_progress(0.0, 0, False)
        try:
            client = distributed.Client(self.scheduler, timeout="10s", set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            expected = "the address of a Dask scheduler that answers, such as tcp://10.0.0.1:8786"
            raise RpojaxError.of_argument(
                "scheduler", f"found {self.scheduler!r} ({reason:.120}), expected {expected}"
            ) from None
        with client:
            return self._collect(distributed, client, self._submit(client, blocks), on_progress)

    def _submit(self, client: Any, blocks: Sequence[int]) -> dict[Any, int]:
        """Task -> block."""
        folder, token = str(self.campaign.directory.resolve()), uuid.uuid4().hex[:8]
        environment = jax_configuration.sent_variables()
        options = {"pure": False, "retries": MAX_ATTEMPTS - 1}
        return {
            client.submit(simulate_block, folder, block, environment, key=f"rpojax-{token}-{block}", **options): block
            for block in blocks
        }

    def _collect(
        self, distributed: Any, client: Any, tasks: Mapping[Any, int], on_progress: ExecutorProgressCallback
    ) -> dict[int, str]:
        """Waits for all tasks; block given up -> reason."""
        done, failed = 0, 0
        failed_blocks: dict[int, str] = {}
        for task in distributed.as_completed(tasks, loop=client.loop):
            block = tasks[task]
            if task.status != "finished":
                failed_blocks[block] = " ".join(str(task.exception()).split())[:300]
                continue
            kind, answer = task.result()
            if kind != "done":
                raise UnfinishedError(answer) if kind == "UnfinishedError" else RpojaxError(answer)
            done += self.campaign.configuration.runs_in_block(block)
            failed += answer
            on_progress(float(done), failed, True)
        return failed_blocks


def simulate_block(directory: str, block: int, environment: dict[str, str]) -> tuple[str, Any]:
    """Task of a worker: simulates one block.

    Returns:
        `done` and the number of failed runs, or the kind and text of an error
    """
    jax_configuration.apply_variables(environment)
    try:
        with _LOCK:
            content = Path(directory, campaign_configuration.FILE_NAME).read_bytes()
            campaign, engine = _campaign_and_engine(directory, content)
            return "done", block_runner.simulate_and_store(campaign, engine, [block], lambda fraction, failures: None)
    except RpojaxError as error:
        return type(error).__name__, str(error)


@functools.lru_cache(maxsize=1)
def _campaign_and_engine(directory: str, content: bytes) -> tuple[Campaign, Any]:
    """Folder and engine, reused while its `campaign.json` has the same content."""
    campaign = Campaign(directory)
    return campaign, campaign_engine.recreate_engine(campaign.configuration, jax.devices()[:1])
