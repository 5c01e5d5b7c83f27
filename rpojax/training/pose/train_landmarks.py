"""Training of the landmark network on crops of random scenes of ray-traced views."""

import dataclasses
import hashlib
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from rpojax.runtime.device_mesh import DeviceMesh
from rpojax.training import checkpoint as checkpoints
from rpojax.training.pose.crop_accuracy import crop_accuracy
from rpojax.training.pose.landmark_loss import landmark_loss
from rpojax.training.pose.landmark_views import LandmarkViews
from rpojax.training.pose.random_crops import CropBatch, random_crops
from rpojax.training.training_steps import (
    BatchPrefetcher,
    TrainingState,
    apply_channel_gains,
    first_state,
    optimizer,
    step_settings,
    training_step,
)
from rpojax.vision.landmark_network.network import Params

_JUDGED_SHARE = 1.0 / 32.0
"""Of the views: those that no step uses, but that the progress is judged by."""
_TURNS = 2
"""Of each crop of a batch."""
_LEAST_JUDGED, _MOST_JUDGED = 4, 256


@dataclasses.dataclass(frozen=True)
class LandmarkTrainingOptions:
    """Options of a training.

    Attributes:
        epochs: passes over the views
        batch: views per step, each in two crops
        seed: of all random numbers
        rate: peak learning rate
        limit_s: wall-clock limit, to which the schedule adapts [s]
    """

    epochs: int = 40
    batch: int = 16
    seed: int = 0
    rate: float = 5e-3
    limit_s: float | None = None


@dataclasses.dataclass(frozen=True)
class LandmarkTrainingProgress:
    """Steps done of how many, accuracy on judged crops, elapsed time [s]."""

    done: int
    total: int
    accuracy: dict[str, float]
    elapsed_s: float


OnLandmarkProgress = Callable[[LandmarkTrainingProgress], None]


@dataclasses.dataclass(frozen=True)
class _Problem:
    """What stays the same from step to step."""

    views: LandmarkViews
    backdrops: np.ndarray
    options: LandmarkTrainingOptions
    trained_count: int
    mesh: DeviceMesh

    @property
    def steps_per_epoch(self) -> int:
        return max(1, self.trained_count // self.options.batch)

    @property
    def steps(self) -> int:
        return self.options.epochs * self.steps_per_epoch

    def progress(self, done: int, elapsed_s: float) -> float:
        """Fraction of the training that is done, by steps or by time."""
        limit_s = self.options.limit_s
        return max(done / self.steps, 0.0 if limit_s is None else elapsed_s / limit_s)

    def batch(self, step: int, progress: float) -> CropBatch:
        """The batch of a step, which depends on the seed and the step alone; an epoch has every view once."""
        del progress
        epoch, place = divmod(step, self.steps_per_epoch)
        order = np.random.default_rng([self.options.seed, 0, epoch]).permutation(self.trained_count)
        chosen = order[place * self.options.batch : (place + 1) * self.options.batch]
        rng = np.random.default_rng([self.options.seed, 1, step])
        return random_crops(self.views, self.backdrops, chosen, rng, _TURNS)


def judged_count(count: int) -> int:
    """How many of so many views no step of a training uses."""
    return min(max(round(_JUDGED_SHARE * count), _LEAST_JUDGED), _MOST_JUDGED)


def train_landmark_network(
    views: LandmarkViews,
    backdrops: np.ndarray,
    options: LandmarkTrainingOptions,
    start: Params,
    checkpoint: Path | None = None,
    on_progress: OnLandmarkProgress = lambda progress: None,
) -> tuple[Params, list[LandmarkTrainingProgress]]:
    """Trains a network from `start`; returns the averaged weights, and the progress after each epoch.

    With a checkpoint an interrupted call continues after its last epoch, to the same result.
    """
    start_time = time.monotonic()
    problem = _problem(views, backdrops, options)
    judged = random_crops(
        views, backdrops, np.arange(problem.trained_count, len(views)), np.random.default_rng([options.seed, 2])
    )
    state, history = first_state(start), list[LandmarkTrainingProgress]()
    key = _digest(problem, start)
    if checkpoint and (found := checkpoints.read_checkpoint(checkpoint, key, state.arrays())):
        state, history = TrainingState(*found[0]), [LandmarkTrainingProgress(**entry) for entry in found[1]]
        start_time -= history[-1].elapsed_s
    done = history[-1].done if history else 0
    progress = problem.progress(done, time.monotonic() - start_time)
    # Where each step leaves it: otherwise the step would be compiled again for the second one.
    state = TrainingState(*problem.mesh.copy(state.arrays()))
    with BatchPrefetcher(problem.batch, done, progress) as batches:
        while done < problem.steps and progress < 1.0:
            state, done, progress = _run_epoch(problem, state, batches, done, progress, start_time)
            accuracy = crop_accuracy(jax.device_get(apply_channel_gains(state.averaged_params)), judged)
            elapsed = time.monotonic() - start_time
            history.append(LandmarkTrainingProgress(done, problem.steps, dataclasses.asdict(accuracy), elapsed))
            if checkpoint:
                entries = [dataclasses.asdict(entry) for entry in history]
                checkpoints.write_checkpoint(checkpoint, key, state.arrays(), entries)
            on_progress(history[-1])
    return apply_channel_gains(state.averaged_params), history


def _problem(views: LandmarkViews, backdrops: np.ndarray, options: LandmarkTrainingOptions) -> _Problem:
    """What stays the same, on as many devices as divide the number of crops of a batch."""
    mesh = DeviceMesh(jax.devices()[: math.gcd(options.batch, jax.device_count())])
    return _Problem(views, backdrops, options, len(views) - judged_count(len(views)), mesh)


def _run_epoch(
    problem: _Problem,
    state: TrainingState,
    batches: BatchPrefetcher[CropBatch],
    done: int,
    progress: float,
    start_time: float,
) -> tuple[TrainingState, int, float]:
    """State, steps done and progress after one epoch, or at the time limit."""
    for _ in range(problem.steps_per_epoch):
        settings = problem.mesh.copy((step_settings(problem.options.rate, progress, done), jax.random.key(done)))
        arrays = problem.mesh.place(batches.next())
        # One step at a time: with several in flight and few cores, one may wait for another for ever.
        step = training_step(_loss, _OPTIMIZER, state.arrays(), (), *settings, arrays)
        state = TrainingState(*jax.block_until_ready(step))
        done += 1
        progress = problem.progress(done, time.monotonic() - start_time)
        if progress >= 1.0:
            break
    return state, done, progress


_OPTIMIZER = optimizer()


def _loss(params: Params, frozen: Any, key: jax.Array, batch: CropBatch) -> jax.Array:
    del frozen, key
    return landmark_loss(params, batch)


def _digest(problem: _Problem, start: Params) -> str:
    """Key of a training for its checkpoint."""
    options = dataclasses.replace(problem.options, limit_s=None)
    digest = hashlib.sha256(repr((options, len(problem.views))).encode())
    for leaf in jax.tree.leaves(start):
        digest.update(np.asarray(leaf).tobytes())
    digest.update(np.ascontiguousarray(problem.views.codes[:: max(1, len(problem.views) // 50)]).tobytes())
    digest.update(problem.views.places.tobytes())
    return digest.hexdigest()
