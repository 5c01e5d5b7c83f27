"""Engines of a test module or session that share what is compiled for them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from rpojax.campaign.execution.batch_engine import BatchEngine


@contextmanager
def shared_programs() -> Iterator[None]:
    """Engines for the same scenario of any length, size and devices use one pair of programs."""
    programs: dict[Any, Any] = {}
    compile_anew = BatchEngine.compile

    def compile_once(engine: BatchEngine) -> None:
        key = (engine._segment_file.model_dump_json(), engine.runs_per_device, tuple(engine.devices))
        if key not in programs:
            compile_anew(engine)
            programs[key] = engine._programs
        engine._programs = programs[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BatchEngine, "compile", compile_once)
        yield
