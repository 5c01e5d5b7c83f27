"""Traces are cached, found again by their identity, and traced again if the file is damaged."""

import gc
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from jaxtyping import Array

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.flight.computer import Stages
from rpojax.flight.control import formation_law
from rpojax.runtime import trace_cache
from rpojax.runtime.trace_cache import Trace
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.state import State

ARGUMENTS = (np.arange(3.0), {"a": np.ones(2)})


class CountedFunction:
    """A function that counts how often it is traced."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self, x: Any, others: dict[str, Any]) -> dict[str, Any]:
        self.times += 1
        return {"sum": x.sum() + others["a"].sum(), "same": others}


def traced(function: CountedFunction, arguments: Any = ARGUMENTS, identity: str | None = "sum") -> Trace:
    """Trace as in a new process: JAX itself remembers traces by the identity of the function, so it is wrapped."""
    return trace_cache.load_or_trace(lambda x, others: function(x, others), arguments, identity)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(trace_cache.FOLDER_VARIABLE, str(tmp_path / "traces"))
    return tmp_path / "traces"


def test_a_cached_trace_is_not_traced_again_and_computes_the_same(folder: Path) -> None:
    function = CountedFunction()
    first = traced(function)
    second = traced(function)
    assert function.times == 1
    assert len(list(folder.iterdir())) == 1
    assert first.call(*ARGUMENTS)["sum"] == second.call(*ARGUMENTS)["sum"] == 5.0
    assert second.outputs["same"]["a"].shape == (2,)


@pytest.mark.parametrize("collecting", [True, False])
@pytest.mark.parametrize("identity", ["sum", None])
def test_garbage_collection_resumes_after_tracing_succeeds_or_fails(
    folder: Path, identity: str | None, collecting: bool
) -> None:
    states = []

    def failing(x: Any) -> Any:
        states.append(gc.isenabled())
        raise RuntimeError("no function")

    def working(x: Any) -> Any:
        states.append(gc.isenabled())
        return x + 1.0

    before = gc.isenabled()
    try:
        (gc.enable if collecting else gc.disable)()
        trace_cache.load_or_trace(working, (np.ones(2),), identity)
        assert gc.isenabled() is collecting
        with pytest.raises(RuntimeError, match="no function"):
            trace_cache.load_or_trace(failing, (np.ones(3),), identity)
        assert gc.isenabled() is collecting
    finally:
        (gc.enable if before else gc.disable)()
    assert states == [False, False]


@pytest.mark.parametrize("change", ["identity", "shape", "type", "structure", "code", "numbers"])
def test_a_change_of_what_the_trace_depends_on_traces_again(
    folder: Path, change: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    function = CountedFunction()
    traced(function)
    identity = "other" if change == "identity" else "sum"
    x, others = ARGUMENTS
    if change == "shape":
        x = np.arange(4.0)
    if change == "type":
        x = x.astype(np.float32)
        others = {"a": others["a"].astype(np.float32)}
    if change == "structure":
        others = {**others, "b": np.ones(1)}
    if change == "code":
        monkeypatch.setattr(trace_cache, "_LOADED_SOURCE", "other code")
        monkeypatch.setattr(trace_cache, "_source_digest", lambda: "other code")
    if change == "numbers":
        partitionable = jax.config.jax_threefry_partitionable  # pyright: ignore[reportAttributeAccessIssue]
        request.addfinalizer(lambda: jax.config.update("jax_threefry_partitionable", partitionable))
        jax.config.update("jax_threefry_partitionable", not partitionable)
    traced(function, (x, others), identity)
    assert function.times == 2
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("damage", ["cut", "turned", "empty"])
def test_a_damaged_trace_is_traced_again(folder: Path, damage: str) -> None:
    function = CountedFunction()
    traced(function)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[:-9], "turned": whole[:200] + b"?" + whole[201:], "empty": b""}[damage])
    assert traced(function).call(*ARGUMENTS)["sum"] == 5.0
    traced(function)
    assert function.times == 2


def test_nothing_is_cached_if_the_source_has_changed_since_it_was_loaded(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trace_cache, "_source_digest", lambda: "edited states")
    assert traced(CountedFunction()).call(*ARGUMENTS)["sum"] == 5.0
    assert not folder.exists()


def test_a_trace_that_cannot_be_written_leaves_no_partial_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    traced(CountedFunction())
    (path,) = folder.iterdir()
    path.unlink()
    path.mkdir()
    assert traced(CountedFunction()).call(*ARGUMENTS)["sum"] == 5.0
    assert list(folder.iterdir()) == [path]


def test_a_function_that_prints_can_be_traced_but_not_cached(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    def printing(x: Any, others: dict[str, Any]) -> Any:
        jax.debug.print("heard")
        return x

    trace = trace_cache.load_or_trace(printing, ARGUMENTS)
    np.testing.assert_array_equal(jax.jit(trace.call)(*ARGUMENTS), ARGUMENTS[0])
    jax.effects_barrier()
    assert "heard" in capfd.readouterr().out
    assert not folder.exists()


def test_nothing_is_cached_without_a_folder_or_without_an_identity(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    traced(CountedFunction(), identity=None)
    monkeypatch.delenv(trace_cache.FOLDER_VARIABLE)
    assert traced(CountedFunction()).call(*ARGUMENTS)["sum"] == 5.0
    assert not folder.exists()


def test_a_folder_that_is_not_writable_is_no_error(folder: Path) -> None:
    folder.write_text("a file where a folder should be")
    assert traced(CountedFunction()).call(*ARGUMENTS)["sum"] == 5.0


def test_a_loop_is_cached_unless_a_stage_is_the_users_own(
    folder: Path, inspection_file: ScenarioFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = []

    def advance(self: BatchEngine, nominal: Params, values: Values, state: State) -> tuple[State, dict[str, Array]]:
        times.append(1)
        return state, {"failed_at": state.failed_at[None]}

    monkeypatch.setattr(BatchEngine, "_advance", advance)
    retuned = inspection_file.model_copy(update={"orbit": inspection_file.orbit.model_copy(update={"raan_deg": 78.0})})
    assert BatchEngine(inspection_file, runs_per_device=1).channel_names() == ["failed_at"]
    assert BatchEngine(retuned, runs_per_device=1).channel_names() == ["failed_at"]
    assert len(times) == 1, "numbers that runs are given are not part of the program"
    own = Stages(formation_law=lambda *given: formation_law.lqr_feedback(*given))
    BatchEngine(inspection_file, runs_per_device=1, stages=own).channel_names()
    assert len(times) == 2
    assert len(list(folder.iterdir())) == 3, "two preparations and the loop of the packaged stages"
