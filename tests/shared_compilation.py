"""Batch engines of different tests share compiled programs."""

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from rpojax.campaign.execution.batch_engine import BatchEngine

_KEPT = 3
"""Programs that stay in memory, about 100 MB each; others are loaded again from the caches on disk."""


@contextmanager
def shared_programs() -> Iterator[None]:
    """Engines for the same scenario (of any duration), batch size and devices use the same programs."""
    programs: OrderedDict[Any, Any] = OrderedDict()
    compile_engine = BatchEngine.compile

    def compile_once(engine: BatchEngine) -> None:
        content = engine._segment_file.model_dump_json()
        assigned = tuple(sorted(engine.design.assigned)) if engine.design else ()
        key = (content, engine.runs_per_device, tuple(engine.devices), engine.batching, assigned)
        if key not in programs:
            compile_engine(engine)
            programs[key] = engine._programs
        programs.move_to_end(key)
        if len(programs) > _KEPT:
            programs.popitem(last=False)
        engine._programs = programs[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BatchEngine, "compile", compile_once)
        yield
