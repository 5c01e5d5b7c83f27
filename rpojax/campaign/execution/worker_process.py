"""A worker process, `python -m rpojax.campaign.execution.worker_process DIR CORES [--allow-plugin]`.

It simulates batches of blocks, and executes the plugin of the scenario if it is told to.

It reads lists of block numbers in JSON from its standard input, one per line, and writes messages as lines of JSON:
`["ready"]` once its programs are compiled, `["progress", fraction, failed]`, `["done", failed]`, or
`["error", kind, text]` before it ends. When its input ends, it ends at once, and unfinished blocks are left to others.
"""

import json
import os
import queue
import sys
import threading
from collections.abc import Sequence

from rpojax.errors import RpojaxError
from rpojax.runtime import jax_environment

ALLOW_PLUGIN = "--allow-plugin"
"""Lets the worker execute the plugin that the scenario names, as the campaign's process does."""


def send(*message: object) -> None:
    """Writes a message to standard output."""
    print(json.dumps(message), flush=True)


def read_batches(batches: "queue.SimpleQueue[list[int]]") -> None:
    """Queues the batches of blocks from standard input, and ends the process when it ends."""
    for line in sys.stdin:
        batches.put(json.loads(line))
    os._exit(0)


def serve(directory: str) -> None:
    """Simulates and stores batches of blocks in the order of their arrival."""
    batches: queue.SimpleQueue[list[int]] = queue.SimpleQueue()
    threading.Thread(target=read_batches, args=(batches,), daemon=True).start()
    import jax

    from rpojax.campaign.execution import block_runner, campaign_engine
    from rpojax.campaign.storage.campaign_folder import Campaign

    campaign = Campaign(directory)
    engine = campaign_engine.recreate_engine(campaign.configuration, jax.devices())
    engine.compile()
    send("ready")
    while True:
        failed = block_runner.simulate_and_store(
            campaign, engine, batches.get(), lambda fraction, failures: send("progress", fraction, failures)
        )
        send("done", failed)


def main(arguments: Sequence[str]) -> None:
    """Serves the campaign folder `arguments[0]` on the cores listed in `arguments[1]`."""
    jax_environment.bind_to_cores({int(core) for core in arguments[1].split(",")})
    try:
        if ALLOW_PLUGIN in arguments[2:]:
            from rpojax.scenario.plugins import plugin_registry

            plugin_registry.permit()
        serve(arguments[0])
    except RpojaxError as error:
        send("error", type(error).__name__, str(error))


if __name__ == "__main__":
    main(sys.argv[1:])
