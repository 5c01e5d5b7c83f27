"""Training loop of a network of the detector: Muon steps, averaged weights, data parallel over the devices.

Muon optimiser: steps along the orthogonalised momentum of a kernel.

Jordan et al., "Muon: an optimizer for hidden layers in neural networks", 2024. On these networks it needs far fewer
steps than Adam.

Weight standardisation with a gain per channel, used in training in place of normalisation layers.

After Brock et al., "Characterizing signal propagation to close the performance gap in unnormalized ResNets", ICLR 2021.
The products are what is stored, so that inference has no such step.
"""

import collections
import dataclasses
import hashlib
import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from rpojax.runtime.device_mesh import DeviceMesh
from rpojax.runtime.jax_environment import available_cores
from rpojax.training import checkpoint as checkpoints
from rpojax.training.detector.augmentation import Batch, augment_batch
from rpojax.training.detector.training_options import (
    NetworkTrainingOptions,
    NetworkTrainingProgress,
    OnNetworkProgress,
)
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
"""Of the odd polynomial of a Newton-Schulz step; five steps take singular values in 0.01..1 to near one."""
_ITERATIONS = 5
Params = dict[str, Any]
"""Arrays of one network by layer and name."""
_OUTPUT_PREFIX = "out"
_MAX_THREADS = 8
_AVERAGE_DECAY = 0.999
_MOMENTUM = 0.9
_KERNEL_RATE_FACTOR = 10.0
"""Learning rate of kernels by that of the other arrays."""
Loss = Callable[[Params, Any, jax.Array, Batch], jax.Array]
"""Of a network's parameters, frozen parameters, a random key and a batch."""
Evaluate = Callable[[Params], dict[str, Any]]
"""Metrics of a network's parameters on the validation images."""


def scale_by_muon(momentum: float) -> optax.GradientTransformation:
    """Transformation of gradients to orthogonalised steps with Nesterov momentum, for kernels (..., in, out)."""

    def initialize(params: Any) -> Any:
        return jax.tree.map(jnp.zeros_like, params)

    def update(updates: Any, state: Any, params: Any = None) -> tuple[Any, Any]:
        del params
        state = jax.tree.map(lambda m, g: momentum * m + g, state, updates)
        step = jax.tree.map(lambda m, g: orthogonalize(momentum * m + g), state, updates)
        return step, state

    return optax.GradientTransformation(initialize, update)


def orthogonalize(kernel: Array) -> Array:
    """A kernel (..., in, out) as a matrix of `out` columns, with its singular values moved near one (Newton-Schulz)."""
    first, second, third = _COEFFICIENTS
    matrix = kernel.reshape(-1, kernel.shape[-1])
    tall = matrix.shape[0] >= matrix.shape[1]
    values = matrix.T if tall else matrix
    values = values / (jnp.sqrt(jnp.sum(values * values)) + 1e-7)
    for _ in range(_ITERATIONS):
        square = values @ values.T
        values = first * values + (second * square + third * square @ square) @ values
    return (values.T if tall else values).reshape(kernel.shape)


def is_output(layer: str) -> bool:
    """Whether a layer gives results of the network; these are not standardised."""
    return layer.startswith(_OUTPUT_PREFIX)


def with_channel_gains(params: Params) -> Params:
    """Trained arrays: the parameters, and a gain per channel for every convolution but the last."""
    gains = {
        layer: {"gain": _channel_norm(values["kernel"])} for layer, values in params.items() if not is_output(layer)
    }
    return {layer: {**values, **gains.get(layer, {})} for layer, values in params.items()}


def apply_channel_gains(trained: Params) -> Params:
    """Parameters of the network: kernels with channels of zero mean whose norm is the gain."""
    return {
        layer: {"kernel": _standardized_kernel(values), "bias": values["bias"]} for layer, values in trained.items()
    }


def _channel_norm(kernel: jax.Array) -> jax.Array:
    """Norm of every channel of a kernel, less its mean."""
    centered = kernel - jnp.mean(kernel, axis=(0, 1, 2), keepdims=True)
    return jnp.sqrt(jnp.sum(centered**2, axis=(0, 1, 2)) + 1e-8)


def _standardized_kernel(values: dict[str, jax.Array]) -> jax.Array:
    kernel = values["kernel"]
    if "gain" not in values:
        return kernel
    centered = kernel - jnp.mean(kernel, axis=(0, 1, 2), keepdims=True)
    return centered / _channel_norm(kernel)[None, None, None, :] * values["gain"][None, None, None, :]


class BatchPrefetcher:
    """Batches from a step on, in order; without a time limit a batch depends on seed and step alone.

    `progress` is the fraction of the training that is done; whether batches are of crops follows it some steps later.
    As many threads prepare them as there are cores, so that an accelerator does not wait for one.
    """

    def __init__(
        self,
        data: DetectionDataset,
        options: NetworkTrainingOptions,
        steps_per_epoch: int,
        first_step: int,
        progress: float,
    ) -> None:
        self.progress = progress
        self._data, self._options, self._steps_per_epoch, self._step = data, options, steps_per_epoch, first_step
        self._threads = min(available_cores(), _MAX_THREADS)
        self._batches: collections.deque[Future[Batch]] = collections.deque()

    def next(self) -> Batch:
        """The batch of the next step."""
        self._fill()
        batch = self._batches.popleft().result()
        self._fill()
        return batch

    def _fill(self) -> None:
        """Has as many batches in preparation as there are threads, and two."""
        while len(self._batches) < self._threads + 2:
            self._batches.append(self._executor.submit(self._prepare, self._step, self.progress))
            self._step += 1

    def _prepare(self, step: int, clock: float) -> Batch:
        progress = step / (self._options.epochs * self._steps_per_epoch)
        if self._options.limit_s is not None:
            progress = max(progress, clock)
        indices = image_indices(len(self._data), self._options, self._steps_per_epoch, step)
        rng = np.random.default_rng([self._options.seed, 1, step])
        return augment_batch(self._data, indices, rng, crops=progress < self._options.pieces_share)

    def __enter__(self) -> "BatchPrefetcher":
        self._executor = ThreadPoolExecutor(self._threads, thread_name_prefix="augmentation")
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)


def image_indices(count: int, options: NetworkTrainingOptions, steps_per_epoch: int, step: int) -> np.ndarray:
    """Indices of the images of a step; an epoch has every image once."""
    epoch, place = divmod(step, steps_per_epoch)
    order = np.random.default_rng([options.seed, 0, epoch]).permutation(count)
    return order[place * options.batch : (place + 1) * options.batch]


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
