"""Chunks of columns of a rerun recording (`.rrd`), with counted ids, so that equal runs have equal content."""

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Array
from rerun.chunk import Chunk

from rpojax.core.frames import hill_frame
from rpojax.flight.stages import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.telemetry import Telemetry

TIMELINE = "sim_time"
"""Name of the only timeline: seconds since the start of the run."""
ViewerChannels = dict[str, np.ndarray]
"""Values of all ticks by name, ticks first."""


class RrdChunks:
    """Chunks of one recording, in the order in which they were added."""

    def __init__(self) -> None:
        self.chunks: list[Chunk] = []

    def add(self, path: str, time_s: np.ndarray, columns: Iterable[Any]) -> None:
        """Adds columns of an entity over simulation time [s]."""
        times = [rr.TimeColumn(TIMELINE, duration=np.asarray(time_s, dtype=np.float64))]
        self._append(Chunk.from_columns(path, times, columns))

    def add_static(self, path: str, *archetypes: rr.AsComponents) -> None:
        """Adds archetypes of an entity that hold at all times."""
        batches = [batch for archetype in archetypes for batch in archetype.as_component_batches()]
        columns = [batch.partition([len(batch.as_arrow_array())]) for batch in batches]
        self._append(Chunk.from_columns(path, [], columns))

    def add_name(self, name: str) -> None:
        """Sets the name of the recording in the viewer."""
        self._append(Chunk.from_property("RecordingInfo", rr.archetypes.RecordingInfo(name=name)))

    def _append(self, chunk: Chunk) -> None:
        """Adds a chunk with counted ids, where rerun derives them from the clock."""
        batch, number = chunk.to_record_batch(), len(self.chunks) + 1
        kind = batch.schema.field(0).type
        rows = pa.array([_row_id(number, row + 1) for row in range(batch.num_rows)], kind)
        metadata = {**(batch.schema.metadata or {}), b"rerun:id": b"chunk_" + _row_id(number, 0).hex().encode()}
        schema = batch.schema.with_metadata(metadata)
        self.chunks += Chunk.from_record_batch(pa.RecordBatch.from_arrays([rows, *batch.columns[1:]], schema=schema))


class ServicerChunks:
    """Chunks of one servicer of a team, in the recording of all: its entities have its name in their paths.

    What is the same for all is recorded by the first one alone.

    Args:
        chunks: of the recording
        name: of the servicer
        shared: paths of entities that all have in common
        is_first: whether it records these
    """

    def __init__(self, chunks: RrdChunks, name: str, shared: Collection[str], is_first: bool) -> None:
        self._chunks, self._name, self._shared, self._is_first = chunks, name, shared, is_first

    def add(self, path: str, time_s: np.ndarray, columns: Iterable[Any]) -> None:
        """Adds columns of an entity over simulation time [s]."""
        if (own := self._own(path)) is not None:
            self._chunks.add(own, time_s, columns)

    def add_static(self, path: str, *archetypes: rr.AsComponents) -> None:
        """Adds archetypes of an entity that hold at all times."""
        if (own := self._own(path)) is not None:
            self._chunks.add_static(own, *archetypes)

    def _own(self, path: str) -> str | None:
        if any(path == shared or path.startswith(f"{shared}/") for shared in self._shared) or "/" not in path:
            return path if self._is_first else None
        return servicer_path(path, self._name)


def servicer_path(path: str, name: str | None) -> str:
    """Path of an entity of a servicer of a team: its name comes after the first part; of one alone, the path itself."""
    root, slash, rest = path.partition("/")
    return path if name is None else f"{root}/{name}{slash}{rest}"


def _row_id(chunk: int, row: int) -> bytes:
    return chunk.to_bytes(8, "big") + row.to_bytes(8, "big")


def write_rrd(chunks: RrdChunks, path: Path, application: str, recording: str, blueprint: rrb.Blueprint) -> None:
    """Writes chunks and the blueprint of the views to a file."""
    stream = rr.RecordingStream(application, recording_id=recording, send_properties=False)
    try:
        stream.save(path)
        stream.send_blueprint(blueprint)
        stream.flush()
        stream.send_chunks(chunks.chunks)
        stream.flush()
    finally:
        stream.disconnect()


@contextmanager
def rerun_strict_mode() -> Iterator[None]:
    """Context in which rerun raises an error for invalid data instead of a warning."""
    before = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)


def observe_tick(_: Stages, scenario: Scenario, params: Params, record: Telemetry) -> dict[str, Array]:
    """Channels of one tick, `R_HN` (3, 3) and `relative_covariance_H` (3, 3) [m^2] of the relative position."""
    R_HN = hill_frame(record.truth.r_TN_N, record.truth.v_TN_N)[0]
    P_N = record.flight.orbit.relative.position_covariance
    own = {"R_HN": R_HN, "relative_covariance_H": R_HN @ P_N @ R_HN.T}
    return {**compute_channels(scenario, params, record), **own}
