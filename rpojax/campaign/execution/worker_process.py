"""A worker process, `python -m rpojax.campaign.execution.worker_process DIR CORES`: simulates blocks that it is given.

It reads lists of block numbers in JSON from its standard input, a line each, and answers in lines of JSON: `["ready"]`
once programs are compiled, `["during", share, failed]`, `["done", failed]`, or `["error", kind, text]` at its end.
When its input ends, so does it, whatever it is doing: its blocks are not finished, and done again.
"""

import json
import os
import queue
import sys
import threading
from collections.abc import Sequence

from rpojax.errors import RpojaxError


def send(*words: object) -> None:
    """Answers with a line."""
    print(json.dumps(words), flush=True)


def read_batches(waves: "queue.SimpleQueue[list[int]]") -> None:
    """Takes in waves of blocks until there are no more, and then ends the process."""
    for line in sys.stdin:
        waves.put(json.loads(line))
    os._exit(0)


def serve(directory: str) -> None:
    """Does waves of blocks as they come in."""
    waves: queue.SimpleQueue[list[int]] = queue.SimpleQueue()
    threading.Thread(target=read_batches, args=(waves,), daemon=True).start()
    import jax

    from rpojax.campaign.execution import block_runner
    from rpojax.campaign.storage.campaign_folder import Campaign

    result = Campaign(directory)
    engine = block_runner.engine_from_configuration(result.configuration, jax.devices())
    engine.compile()
    send("ready")
    while True:
        wave = waves.get()
        failed = block_runner.simulate_and_store(
            result, engine, wave, lambda share, failures: send("during", share, failures)
        )
        send("done", failed)


def main(words: Sequence[str]) -> None:
    """Works on the folder `words[0]`, on the cores listed in `words[1]`."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core) for core in words[1].split(",")})
    try:
        serve(words[0])
    except RpojaxError as error:
        send("error", type(error).__name__, str(error))


if __name__ == "__main__":
    main(sys.argv[1:])
