"""Margins of simulated runs as a limit state: standard normal variables of the dispersions, and keys of the noise.

The number of a run is the key of all its noise: sensor noise, hand-over errors, outliers, and dispersions that are no
function of normal variables. Chains redraw the key of one stream of random numbers in one stretch of time, which then
replaces that of the run there.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ndtr

from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints, LatentSpace
from rpojax.analysis.reliability.simulated_failures.failure_margin import Failure, SimulatedRuns, margins, needs_drifts
from rpojax.campaign.execution.batch_engine import BatchEngine, RedrawnNoise
from rpojax.campaign.execution.block_recording import ChannelRecorder, recorded_channels
from rpojax.campaign.execution.passive_safety import NoDrifts
from rpojax.campaign.experiment_design import Design
from rpojax.core import random_streams
from rpojax.core.random_streams import Stream
from rpojax.dispersions.coordinate_source import clip_to_open_interval
from rpojax.dispersions.designs.design_sections import IndependentDesign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.scenario.dispersed_numbers.dispersion_keys import coordinate_count, nominal_numbers
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.simulation.outcomes.judgement import judge

REDRAWN_STREAMS = (
    Stream.GPS,
    Stream.STAR_TRACKER,
    Stream.GYRO,
    Stream.BOX_CAMERA,
    Stream.THRUSTER,
    Stream.SENSOR_BIAS,
    Stream.CHAMBER_PRESSURE,
    Stream.ADDITIONAL_SENSORS,
)
"""Streams from which numbers are drawn at every tick."""
_REDRAWN = 0x52454452
"""Number that separates keys of redrawn noise from those of runs."""
_RUN_ID_MASK = 2**31 - 1


class SimulatedMargins:
    """Margins of runs of a scenario to a failure.

    Attributes:
        space: standard normal variables of the scenario
        failure: whose margins they are
        seed: master seed of the runs
        latent: space of the points
    """

    def __init__(
        self,
        space: StandardNormalSpace,
        failure: Failure,
        seed: int,
        runs_per_device: int | None = None,
        on_runs: Callable[[int, int], None] = lambda runs, failed: None,
    ) -> None:
        """`on_runs` is called after each batch with the number of its runs, and of those that failed."""
        self.space, self.failure, self.seed = space, failure, seed
        file = space.file.model_copy(update={"design": IndependentDesign(kind="independent")})
        self._engine = BatchEngine(
            file, runs_per_device, design=Design(RunRange(0, 1), self._coordinates(np.zeros((1, space.dimension))))
        )
        if not needs_drifts(failure):
            engine = self._engine
            engine.passive_safety = NoDrifts(
                file, engine.scenario, engine.member_params[0], engine.runs_per_device, engine.devices
            )
        self._on_runs = on_runs
        segments = self._engine.segment_count
        self.latent = LatentSpace(space.dimension, 1 + segments * len(REDRAWN_STREAMS), first_is_of_all=True)
        self._stream_keys = jax.jit(jax.vmap(self._redrawn_key))

    def compile(self) -> None:
        """Compiles the programs, once."""
        self._engine.compile()

    def __call__(self, points: LatentPoints) -> np.ndarray:
        """Margins (n,) of points."""
        parts = []
        for first in range(0, len(points), self._engine.capacity):
            rows = np.arange(first, first + self._engine.capacity)
            counted = int((rows < len(points)).sum())
            # The last batch is padded with its first point.
            batch = points.rows(np.where(rows < len(points), rows, first))
            parts.append(margins(self.simulate(batch), self.failure)[:counted])
            self._on_runs(counted, int((parts[-1] <= 0.0).sum()))
        return np.concatenate(parts) if parts else np.zeros(0)

    def simulate(self, points: LatentPoints) -> SimulatedRuns:
        """Runs of as many points as the devices take at once."""
        engine = self._engine
        prepared = engine.prepare(self.seed, run_numbers(points), self._coordinates(points.x))
        recorder = ChannelRecorder(engine.scenario.ticks, (), lambda name: False, recorded_channels(engine.file))
        last = None
        for segment in engine.simulate(prepared, self._redrawn_noise(points)):
            recorder.add_segment(segment)
            last = segment
        assert last is not None
        records = {name: np.moveaxis(values, -1, 0) for name, values in recorder.records.items()}
        failure = np.where(last.failed_at < engine.file.duration_s, last.failure, 0)
        drifts = engine.passive_safety.evaluate(prepared.drawn, recorder.records) if needs_drifts(self.failure) else {}
        judged = judge(engine.file, prepared.used, records, failure, last.failed_at)
        return SimulatedRuns(engine.file, records, prepared.used, drifts, judged)

    def _coordinates(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Coordinates (runs, n) in the unit cube of each dispersion, by its name, from normal variables (runs, k)."""
        space = self.space
        found = {}
        for entry in space.mapped:
            normals = np.zeros((len(z), coordinate_count(space.file, entry)))
            normals[:, entry.varies(nominal_numbers(space.file, entry))] = z[:, space.slices[entry.name]]
            found[entry.name] = clip_to_open_interval(ndtr(normals))
        return found

    def _redrawn_key(self, number: jax.Array, stream: jax.Array) -> jax.Array:
        master = random_streams.fold_in(jnp.asarray(random_streams.master_key(self.seed)), _REDRAWN)
        return random_streams.fold_in(random_streams.fold_in(master, number), stream)

    def _redrawn_noise(self, points: LatentPoints) -> RedrawnNoise | None:
        """Keys of the streams that are not the runs' own; None if no stream is redrawn."""
        numbers = points.keys[:, 1:]
        if not numbers.any():
            return None
        runs, segments = len(points), self._engine.segment_count
        numbers = numbers.reshape(runs, segments, len(REDRAWN_STREAMS))
        streams = np.broadcast_to(np.array(REDRAWN_STREAMS, dtype=np.uint32), numbers.shape)
        found = np.asarray(self._stream_keys(numbers.reshape(-1), streams.reshape(-1)))
        keys = np.zeros((segments, len(Stream) + 1, 2, runs), dtype=np.uint32)
        chosen = np.zeros((segments, len(Stream) + 1, runs), dtype=bool)
        keys[:, np.array(REDRAWN_STREAMS)] = np.moveaxis(found.reshape(*numbers.shape, 2), 0, -1)
        chosen[:, np.array(REDRAWN_STREAMS)] = np.moveaxis(numbers != 0, 0, -1)
        return RedrawnNoise(keys, chosen)


def run_numbers(points: LatentPoints) -> np.ndarray:
    """Numbers (n,) of the runs whose noise points have."""
    return (points.keys[:, 0] & np.uint32(_RUN_ID_MASK)).astype(np.int64)
