"""Batch engines of different tests share compiled programs."""

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import pytest

from rpojax.campaign.execution.batch_engine import BatchEngine

_KEPT = 2
"""Engines whose programs stay in memory, 250 MB each; others are loaded again from the caches on disk."""


@contextmanager
def shared_programs() -> Iterator[None]:
    """Engines for the same scenario (of any duration), batch size and devices use the same traces and programs."""
    engines: OrderedDict[Any, BatchEngine] = OrderedDict()
    compile_engine = BatchEngine.compile
    trace_loop = BatchEngine._loop_traces.func

    def key(engine: BatchEngine) -> Any:
        content = engine._segment_file.model_dump_json()
        assigned = tuple(sorted(engine.design.assigned)) if engine.design else ()
        safety = (engine.passive_safety.mission_steps, engine.passive_safety.runs_at_once)
        return content, engine.runs_per_device, tuple(engine.devices), engine.batching, assigned, safety

    def loop_traces(engine: BatchEngine) -> Any:
        kept = engines.get(key(engine))
        return trace_loop(engine) if kept in (None, engine) else kept._loop_traces

    def compile_once(engine: BatchEngine) -> None:
        kept = engines.pop(key(engine), engine)
        compile_engine(kept)
        engines[key(engine)] = kept
        if len(engines) > _KEPT:
            engines.popitem(last=False)
        engine._programs = kept._programs
        engine.passive_safety._programs = kept.passive_safety._programs

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BatchEngine, "compile", compile_once)
        patch.setattr(BatchEngine, "_loop_traces", _cached("_loop_traces", loop_traces))
        yield


def _cached(name: str, function: Any) -> Any:
    """A property of the class that is evaluated once for each engine."""
    found = cached_property(function)
    found.__set_name__(BatchEngine, name)
    return found
