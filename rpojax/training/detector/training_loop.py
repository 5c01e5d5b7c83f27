"""Training loop of a network of the detector, data parallel over the devices."""

import dataclasses
import hashlib
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax

from rpojax.runtime.device_mesh import DeviceMesh
from rpojax.training import checkpoint as checkpoints
from rpojax.training.detector.augmentation import Batch, augment_batch
from rpojax.training.detector.training_options import (
    NetworkTrainingOptions,
    NetworkTrainingProgress,
    OnNetworkProgress,
)
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.training.training_steps import (
    BatchPrefetcher,
    Loss,
    Params,
    TrainingState,
    apply_channel_gains,
    first_state,
    optimizer,
    step_settings,
    training_step,
)

Evaluate = Callable[[Params], dict[str, Any]]
"""Metrics of a network's parameters on the validation images."""


def image_indices(count: int, options: NetworkTrainingOptions, steps_per_epoch: int, step: int) -> np.ndarray:
    """Indices of the images of a step; an epoch has every image once."""
    epoch, place = divmod(step, steps_per_epoch)
    order = np.random.default_rng([options.seed, 0, epoch]).permutation(count)
    return order[place * options.batch : (place + 1) * options.batch]


@dataclasses.dataclass(frozen=True)
class _Problem:
    """What stays the same from step to step."""

    loss: Loss
    optimizer: optax.GradientTransformation
    frozen: Any
    options: NetworkTrainingOptions
    steps_per_epoch: int
    mesh: DeviceMesh

    @property
    def steps(self) -> int:
        return self.options.epochs * self.steps_per_epoch

    def progress(self, done: int, elapsed_s: float) -> float:
        """Fraction of the training that is done, by steps or by time."""
        limit_s = self.options.limit_s
        return max(done / self.steps, 0.0 if limit_s is None else elapsed_s / limit_s)


def train_network(
    loss: Loss,
    start: Params,
    frozen: Any,
    data: DetectionDataset,
    options: NetworkTrainingOptions,
    evaluate: Evaluate,
    checkpoint: Path | None = None,
    on_progress: OnNetworkProgress = lambda progress: None,
) -> tuple[Params, list[NetworkTrainingProgress]]:
    """Trains a network from `start`; returns the averaged weights, and the progress after each epoch.

    With a checkpoint an interrupted call continues after its last epoch, to the same result. With a time limit the
    learning rate schedule ends at the limit.
    """
    start_time = time.monotonic()
    problem = _training_problem(loss, frozen, options, data)
    state = first_state(start)
    history: list[NetworkTrainingProgress] = []
    done, progress = 0, 0.0
    key = _training_digest(data, options, (start, frozen))
    if checkpoint and (found := checkpoints.read_checkpoint(checkpoint, key, state.arrays())):
        state, history = TrainingState(*found[0]), [NetworkTrainingProgress(**entry) for entry in found[1]]
        done = history[-1].done
        start_time -= history[-1].elapsed_s
        progress = problem.progress(done, history[-1].elapsed_s)
    # Where each step leaves it: otherwise the step would be compiled again for the second one.
    state = TrainingState(*problem.mesh.copy(state.arrays()))

    def prepare(step: int, clock: float) -> Batch:
        return _prepare_batch(problem, data, step, clock)

    with BatchPrefetcher(prepare, done, progress) as batches:
        while done < problem.steps and progress < 1.0:
            state, done, progress = _run_epoch(problem, state, batches, done, progress, start_time)
            elapsed = time.monotonic() - start_time
            metrics = evaluate(jax.device_get(apply_channel_gains(state.averaged_params)))
            precision = metrics["map50"] or 0.0, metrics["map50_95"] or 0.0
            history.append(NetworkTrainingProgress(done, problem.steps, *precision, elapsed))
            if checkpoint:
                entries = [dataclasses.asdict(entry) for entry in history]
                checkpoints.write_checkpoint(checkpoint, key, state.arrays(), entries)
            on_progress(history[-1])
    return apply_channel_gains(state.averaged_params), history


def _training_problem(loss: Loss, frozen: Any, options: NetworkTrainingOptions, data: DetectionDataset) -> _Problem:
    """What stays the same, with frozen parameters on as many devices as divide the number of images of a batch."""
    mesh = DeviceMesh(jax.devices()[: math.gcd(options.batch, jax.device_count())])
    return _Problem(loss, optimizer(), mesh.copy(frozen), options, max(1, len(data) // options.batch), mesh)


def _run_epoch(
    problem: _Problem,
    state: TrainingState,
    batches: BatchPrefetcher[Batch],
    done: int,
    progress: float,
    start_time: float,
) -> tuple[TrainingState, int, float]:
    """State, steps done and progress after one epoch, or at the time limit."""
    for _ in range(problem.steps_per_epoch):
        batches.progress = progress
        settings = step_settings(problem.options.rate, progress, done)
        state = _run_step(problem, state, settings, jax.random.key(done), batches.next())
        done += 1
        progress = problem.progress(done, time.monotonic() - start_time)
        if progress >= 1.0:
            break
    return state, done, progress


def _run_step(
    problem: _Problem, state: TrainingState, settings: jax.Array, key: jax.Array, batch: Batch
) -> TrainingState:
    arrays = problem.mesh.place(batch)
    whole = problem.mesh.copy((settings, key))
    # One step at a time: with several in flight and few cores, the parts of one may wait for those of another for ever.
    return TrainingState(
        *jax.block_until_ready(
            training_step(problem.loss, problem.optimizer, state.arrays(), problem.frozen, *whole, arrays)
        )
    )


def _prepare_batch(problem: _Problem, data: DetectionDataset, step: int, clock: float) -> Batch:
    """The batch of a step; whether it is of crops follows the clock some steps later."""
    options = problem.options
    progress = step / problem.steps if options.limit_s is None else max(step / problem.steps, clock)
    indices = image_indices(len(data), options, problem.steps_per_epoch, step)
    rng = np.random.default_rng([options.seed, 1, step])
    return augment_batch(data, indices, rng, crops=progress < options.pieces_share)


def _training_digest(data: DetectionDataset, options: NetworkTrainingOptions, weights: Any) -> str:
    """Key of a training for its checkpoint."""
    digest = hashlib.sha256(repr((dataclasses.replace(options, limit_s=None), len(data))).encode())
    for leaf in jax.tree.leaves(weights):
        digest.update(np.asarray(leaf).tobytes())
    digest.update(data.images[:: max(1, len(data) // 50)].tobytes())
    digest.update(np.concatenate(data.boxes).tobytes())
    return digest.hexdigest()
