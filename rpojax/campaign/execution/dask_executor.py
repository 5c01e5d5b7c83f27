"""Blocks of a campaign on a running Dask cluster, whose workers see the campaign's folder under the same path."""

import functools
import os
import threading
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from rpojax.campaign.execution import block_runner, executors
from rpojax.campaign.storage import campaign_json
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.runtime import trace_cache

_LOCK = threading.Lock()
_FORWARDED_VARIABLES = (
    *("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR", "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"),
    *("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", trace_cache.FOLDER_VARIABLE),
)
"""What workers are told of the environment, unless they know better."""


@dataclass(frozen=True)
class DaskExecutor:
    """Workers of a Dask scheduler, such as `tcp://10.0.0.1:8786`."""

    campaign: Campaign
    scheduler: str

    def run_blocks(self, blocks: Sequence[int], on_progress: executors.ExecutorProgressCallback) -> dict[int, str]:
        """Does some blocks, each a task; Dask does those again whose worker died, until it suspects them of it."""
        executors.check_default_stages(self.campaign)
        distributed = _import_distributed()
        on_progress(0.0, 0, False)
        try:
            client = distributed.Client(self.scheduler, timeout="10s", set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            expected = "the address of a Dask scheduler that answers, such as tcp://10.0.0.1:8786"
            raise RpojaxError(f"--scheduler: found {self.scheduler!r} ({reason:.120}), expected {expected}") from None
        with client:
            return self._collect(distributed, client, blocks, on_progress)

    def _collect(
        self, distributed: Any, client: Any, blocks: Sequence[int], tell: executors.ExecutorProgressCallback
    ) -> dict[int, str]:
        folder, token = str(self.campaign.directory.resolve()), uuid.uuid4().hex[:8]
        told = {name: os.environ[name] for name in _FORWARDED_VARIABLES if name in os.environ}
        retries = executors.MAX_ATTEMPTS - 1
        tasks = {
            client.submit(
                simulate_block, folder, block, told, key=f"rpojax-{token}-{block}", pure=False, retries=retries
            ): block
            for block in blocks
        }
        done, failed = 0, 0
        given_up: dict[int, str] = {}
        for task in distributed.as_completed(tasks, loop=client.loop):
            block = tasks[task]
            if task.status != "finished":
                given_up[block] = " ".join(str(task.exception()).split())[:300]
                continue
            kind, answer = task.result()
            if kind != "done":
                raise UnfinishedError(answer) if kind == "UnfinishedError" else RpojaxError(answer)
            done, failed = done + campaign_json.runs_in_block(self.campaign.configuration, block), failed + answer
            tell(float(done), failed, True)
        return given_up


def _import_distributed() -> Any:
    try:
        import distributed
    except ModuleNotFoundError:
        raise RpojaxError(
            "--executor: found no Dask, expected the package `distributed` (pip install 'rpojax[dask]')"
        ) from None
    return distributed


def simulate_block(directory: str, block: int, environment: dict[str, str]) -> tuple[str, Any]:
    """On a worker: does one block; answers `done` and its failed runs, or the kind and text of an error."""
    for name, value in environment.items():
        if name in os.environ:
            continue
        if not name.startswith("JAX_"):
            # Read when the first thing is computed: the same program as at home, so that numbers are the same.
            os.environ[name] = value
        else:
            # Said to jax itself, which has read the environment already.
            kind = {"DIR": str, "SECS": float, "BYTES": int}[name.rpartition("_")[2]]
            jax.config.update(name.lower(), kind(value))
    try:
        with _LOCK:
            result, engine = _campaign_and_engine(directory, Path(directory, campaign_json.FILE_NAME).read_bytes())
            return "done", block_runner.simulate_and_store(result, engine, [block], lambda share, failures: None)
    except RpojaxError as error:
        return type(error).__name__, str(error)


@functools.lru_cache(maxsize=1)
def _campaign_and_engine(directory: str, content: bytes) -> tuple[Campaign, Any]:
    """Folder and engine; the same ones as long as its `campaign.json` has the same content."""
    result = Campaign(directory)
    return result, block_runner.engine_from_configuration(result.configuration, jax.devices()[:1])
