"""Training loop of a network of the detector: Muon steps, averaged weights, data parallel over the devices."""

import dataclasses
import hashlib
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from rpojax.runtime.device_mesh import DeviceMesh
from rpojax.training import checkpoint as checkpoints
from rpojax.training.detector.augmentation import Batch
from rpojax.training.detector.batch_prefetch import BatchPrefetcher
from rpojax.training.detector.muon_optimizer import scale_by_muon
from rpojax.training.detector.training_options import (
    NetworkTrainingOptions,
    NetworkTrainingProgress,
    OnNetworkProgress,
)
from rpojax.training.detector.weight_standardization import (
    Params,
    apply_channel_gains,
    is_output,
    with_channel_gains,
)
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

_AVERAGE_DECAY = 0.999
_MOMENTUM = 0.9
_KERNEL_RATE_FACTOR = 10.0
"""Learning rate of kernels by that of the other arrays."""

Loss = Callable[[Params, Any, jax.Array, Batch], jax.Array]
"""Of a network's parameters, frozen parameters, a random key and a batch."""
Evaluate = Callable[[Params], dict[str, Any]]
"""Metrics of a network's parameters on the validation images."""


@dataclasses.dataclass(frozen=True)
class TrainingState:
    """Trained arrays, their exponential moving average, and the state of the optimiser."""

    params: Params
    averaged_params: Params
    optimizer_state: Any


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
    params = with_channel_gains(start)
    state = TrainingState(params, params, problem.optimizer.init(params))
    history: list[NetworkTrainingProgress] = []
    done, progress = 0, 0.0
    key = _training_digest(data, options, (start, frozen))
    if checkpoint and (found := checkpoints.read_checkpoint(checkpoint, key, _state_arrays(state))):
        state, history = TrainingState(*found[0]), [NetworkTrainingProgress(**entry) for entry in found[1]]
        done = history[-1].done
        start_time -= history[-1].elapsed_s
        progress = problem.progress(done, history[-1].elapsed_s)
    # Where each step leaves it: otherwise the step would be compiled again for the second one.
    state = TrainingState(*problem.mesh.copy(_state_arrays(state)))
    with BatchPrefetcher(data, options, problem.steps_per_epoch, done, progress) as batches:
        while done < problem.steps and progress < 1.0:
            state, done, progress = _run_epoch(problem, state, batches, done, progress, start_time)
            elapsed = time.monotonic() - start_time
            metrics = evaluate(jax.device_get(apply_channel_gains(state.averaged_params)))
            precision = metrics["map50"] or 0.0, metrics["map50_95"] or 0.0
            history.append(NetworkTrainingProgress(done, problem.steps, *precision, elapsed))
            if checkpoint:
                entries = [dataclasses.asdict(entry) for entry in history]
                checkpoints.write_checkpoint(checkpoint, key, _state_arrays(state), entries)
            on_progress(history[-1])
    return apply_channel_gains(state.averaged_params), history


def _training_problem(loss: Loss, frozen: Any, options: NetworkTrainingOptions, data: DetectionDataset) -> _Problem:
    """What stays the same, with frozen parameters on as many devices as divide the number of images of a batch."""
    mesh = DeviceMesh(jax.devices()[: math.gcd(options.batch, jax.device_count())])
    return _Problem(loss, _optimizer(), mesh.copy(frozen), options, max(1, len(data) // options.batch), mesh)


def _run_epoch(
    problem: _Problem, state: TrainingState, batches: BatchPrefetcher, done: int, progress: float, start_time: float
) -> tuple[TrainingState, int, float]:
    """State, steps done and progress after one epoch, or at the time limit."""
    for _ in range(problem.steps_per_epoch):
        batches.progress = progress
        rate = problem.options.rate * _learning_rate_factor(progress, done)
        settings = jnp.asarray([rate, min(_AVERAGE_DECAY, (1.0 + done) / (10.0 + done))], jnp.float32)
        state = _run_step(problem, state, settings, jax.random.key(done), batches.next())
        done += 1
        progress = problem.progress(done, time.monotonic() - start_time)
        if progress >= 1.0:
            break
    return state, done, progress


def _state_arrays(state: TrainingState) -> tuple[Params, Params, Any]:
    return state.params, state.averaged_params, state.optimizer_state


def _run_step(
    problem: _Problem, state: TrainingState, settings: jax.Array, key: jax.Array, batch: Batch
) -> TrainingState:
    arrays = problem.mesh.place(batch)
    whole = problem.mesh.copy((settings, key))
    # One step at a time: with several in flight and few cores, the parts of one may wait for those of another for ever.
    return TrainingState(
        *jax.block_until_ready(
            _training_step(problem.loss, problem.optimizer, _state_arrays(state), problem.frozen, *whole, arrays)
        )
    )


@partial(jax.jit, static_argnums=(0, 1))
def _training_step(
    loss: Loss,
    optimizer: optax.GradientTransformation,
    state: tuple[Params, Params, Any],
    frozen: Any,
    settings: jax.Array,
    key: jax.Array,
    batch: Batch,
) -> tuple[Params, Params, Any]:
    """One step; `settings` are the learning rate and the decay of the moving average."""
    params, average, optimizer_state = state
    rate, decay = settings[0], settings[1]
    gradient = jax.grad(lambda p: loss(apply_channel_gains(p), frozen, key, batch))(params)
    with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer power
        update, optimizer_state = optimizer.update(gradient, optimizer_state, params)
    params = jax.tree.map(lambda p, u: p - rate * u, params, update)
    average = jax.tree.map(lambda a, p: decay * a + (1.0 - decay) * p, average, params)
    return params, average, optimizer_state


def _learning_rate_factor(progress: float, done: int) -> float:
    """Learning rate by its peak: linear warm-up over 200 steps, then half a cosine down to a hundredth."""
    return min(1.0, (done + 1) / 200.0) * (0.505 + 0.495 * float(np.cos(np.pi * min(progress, 1.0))))


def _optimizer() -> optax.GradientTransformation:
    """Muon for kernels, Adam for the rest; the learning rate, which may follow the clock, is applied in the step."""
    rest = optax.scale_by_adam(b2=0.99, eps=1e-7)
    kernels = optax.chain(scale_by_muon(_MOMENTUM), optax.scale(_KERNEL_RATE_FACTOR))
    return optax.chain(
        optax.clip_by_global_norm(5.0), optax.multi_transform({"kernel": kernels, "rest": rest}, _optimizer_labels)
    )


def _optimizer_labels(trained: Params) -> dict[str, dict[str, str]]:
    """Optimiser of each array."""
    return {
        layer: {name: "kernel" if name == "kernel" and not is_output(layer) else "rest" for name in values}
        for layer, values in trained.items()
    }


def _training_digest(data: DetectionDataset, options: NetworkTrainingOptions, weights: Any) -> str:
    """Key of a training for its checkpoint."""
    digest = hashlib.sha256(repr((dataclasses.replace(options, limit_s=None), len(data))).encode())
    for leaf in jax.tree.leaves(weights):
        digest.update(np.asarray(leaf).tobytes())
    digest.update(data.images[:: max(1, len(data) // 50)].tobytes())
    digest.update(np.concatenate(data.boxes).tobytes())
    return digest.hexdigest()
