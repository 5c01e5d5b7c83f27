"""How networks of the detector are trained: orthogonal steps, a running mean of the weights, batches made ahead.

Three things make it quick on a CPU. The pictures of a step are spread over the devices, of which there is one for each
core. The first part of a training may see pieces of the pictures, at a quarter of the cost. And kernels are learnt as a
direction and a gain for each channel (Brock et al., "Characterizing signal propagation to close the performance gap in
unnormalized ResNets", ICLR 2021), which does for convergence what a normalisation would; the weights that are written
are the products, and the network that flies has no trace of it.
"""

import dataclasses
import hashlib
import math
import queue
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from rpojax.training import checkpoint as checkpoints
from rpojax.training.detector.augmentation import Batch, augment_batch
from rpojax.training.detector.muon_optimizer import scale_by_muon
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

_AVERAGE_DECAY = 0.999
_OUTPUT_LAYER = "out"
_MOMENTUM = 0.9
_KERNEL_RATE_FACTOR = 10.0
"""Rate of kernels by that of the rest."""

Params = dict[str, Any]
"""Arrays of one network by layer and name."""
Loss = Callable[[Params, Any, jax.Array, jax.Array, jax.Array, jax.Array], jax.Array]
"""Of a network's parameters, what is not trained, a random key, pictures, boxes and weights as in `Batch`."""
Evaluate = Callable[[Params], dict[str, Any]]
"""Figures of a network's parameters on pictures held out."""


@dataclasses.dataclass(frozen=True)
class NetworkTrainingOptions:
    """How a network is trained.

    Attributes:
        epochs: passes over the data
        batch: pictures a step
        seed: of everything random
        rate: the largest
        limit_s: wall-clock limit [s]
        pieces_share: part of the training that sees pieces of pictures
    """

    epochs: int = 100
    batch: int = 32
    seed: int = 0
    rate: float = 5e-3
    limit_s: float | None = None
    pieces_share: float = 0.5


@dataclasses.dataclass(frozen=True)
class NetworkTrainingProgress:
    """How far training is: step of so many, figures on held-out pictures, seconds so far."""

    done: int
    total: int
    map50: float
    map50_95: float
    elapsed_s: float


OnNetworkProgress = Callable[[NetworkTrainingProgress], None]


@dataclasses.dataclass(frozen=True)
class TrainingState:
    """What training carries: weights, their running mean, and the optimiser's state."""

    params: Params
    averaged_params: Params
    optimizer_state: Any


def train_network(
    loss: Loss,
    start: Params,
    frozen: Any,
    data: DetectionDataset,
    options: NetworkTrainingOptions,
    evaluate: Evaluate,
    checkpoint: Path | None = None,
    on_progress: OnNetworkProgress = lambda step: None,
) -> tuple[Params, list[NetworkTrainingProgress]]:
    """Trains a network from `start` and returns the running mean of its weights with the history of checks.

    With a checkpoint an interrupted call goes on after the last finished pass, to the same result. A limit shortens
    the schedule: the rate has fallen to its end when the time is over.
    """
    start_time = time.monotonic()
    per_epoch = max(1, len(data) // options.batch)
    total = options.epochs * per_epoch
    params = with_channel_gains(start)
    optimiser = _optimiser()
    state = TrainingState(params, params, optimiser.init(params))
    history: list[NetworkTrainingProgress] = []
    done, progress = 0, 0.0
    key = _training_digest(data, options, (start, frozen))
    if checkpoint and (found := checkpoints.read_checkpoint(checkpoint, key, _state_arrays(state))):
        state, history = TrainingState(*found[0]), [NetworkTrainingProgress(**step) for step in found[1]]
        done = history[-1].done
        start_time -= history[-1].elapsed_s
        progress = _progress_fraction(done, total, history[-1].elapsed_s, options.limit_s)
    with _BatchPrefetcher(data, options, per_epoch, done, progress) as prepared:
        while done < total and progress < 1.0:
            for _ in range(per_epoch):
                prepared.progress = progress
                settings = jnp.asarray(
                    [
                        options.rate * _learning_rate_factor(progress, done),
                        min(_AVERAGE_DECAY, (1.0 + done) / (10.0 + done)),
                    ],
                    jnp.float32,
                )
                state = _run_step(loss, optimiser, state, frozen, settings, jax.random.key(done), prepared.next())
                done += 1
                progress = _progress_fraction(done, total, time.monotonic() - start_time, options.limit_s)
                if progress >= 1.0:
                    break
            elapsed = time.monotonic() - start_time
            figures = evaluate(jax.device_get(apply_channel_gains(state.averaged_params)))
            history.append(
                NetworkTrainingProgress(done, total, figures["map50"] or 0.0, figures["map50_95"] or 0.0, elapsed)
            )
            if checkpoint:
                checkpoints.write_checkpoint(
                    checkpoint, key, _state_arrays(state), [dataclasses.asdict(step) for step in history]
                )
            on_progress(history[-1])
    return apply_channel_gains(state.averaged_params), history


def _state_arrays(state: TrainingState) -> tuple[Params, Params, Any]:
    return state.params, state.averaged_params, state.optimizer_state


def _run_step(
    loss: Loss,
    optimiser: optax.GradientTransformation,
    state: TrainingState,
    frozen: Any,
    settings: jax.Array,
    key: jax.Array,
    made: Batch,
) -> TrainingState:
    arrays = _shard(made.images, made.boxes, made.weight)
    # One step at a time: where several wait for few cores, the parts of one may wait for those of another for ever.
    return TrainingState(
        *jax.block_until_ready(_training_step(loss, optimiser, _state_arrays(state), frozen, settings, key, *arrays))
    )


def _shard(*arrays: np.ndarray) -> list[jax.Array]:
    """Arrays with their rows spread over the devices, as far as they can be."""
    count = math.gcd(len(arrays[0]), jax.device_count())
    mesh = Mesh(np.array(jax.devices()[:count]), ("pictures",))
    return jax.device_put(list(arrays), NamedSharding(mesh, PartitionSpec("pictures")))


@partial(jax.jit, static_argnums=(0, 1))
def _training_step(
    loss: Loss,
    optimiser: optax.GradientTransformation,
    carried: tuple[Params, Params, Any],
    frozen: Any,
    settings: jax.Array,
    key: jax.Array,
    images: jax.Array,
    boxes: jax.Array,
    weight: jax.Array,
) -> tuple[Params, Params, Any]:
    """One step; `settings` are the rate and how much of the running mean stays."""
    params, mean, state = carried
    rate, decay = settings[0], settings[1]
    gradient = jax.grad(lambda p: loss(apply_channel_gains(p), frozen, key, images, boxes, weight))(params)
    with jax.numpy_dtype_promotion("standard"):  # optax raises a number to the power of its count
        update, state = optimiser.update(gradient, state, params)
    params = jax.tree.map(lambda p, c: p - rate * c, params, update)
    mean = jax.tree.map(lambda m, p: decay * m + (1.0 - decay) * p, mean, params)
    return params, mean, state


def _progress_fraction(done: int, total: int, elapsed_s: float, limit_s: float | None) -> float:
    """How much of the training is over, by steps or by time."""
    return max(done / total, 0.0 if limit_s is None else elapsed_s / limit_s)


def _learning_rate_factor(progress: float, done: int) -> float:
    """Rate by its largest: a rise over 200 steps, then half a cosine down to a hundredth."""
    return min(1.0, (done + 1) / 200.0) * (0.505 + 0.495 * float(np.cos(np.pi * min(progress, 1.0))))


def _optimiser() -> optax.GradientTransformation:
    """Orthogonal steps for kernels, Adam for the rest. The rate is applied outside, so that it may follow the clock."""
    rest = optax.scale_by_adam(b2=0.99, eps=1e-7)
    kernels = optax.chain(scale_by_muon(_MOMENTUM), optax.scale(_KERNEL_RATE_FACTOR))
    return optax.chain(
        optax.clip_by_global_norm(5.0), optax.multi_transform({"kernel": kernels, "rest": rest}, _optimizer_labels)
    )


def _optimizer_labels(trained: Params) -> dict[str, dict[str, str]]:
    """Which way of stepping each array takes."""
    return {
        layer: {name: "kernel" if name == "kernel" and layer != _OUTPUT_LAYER else "rest" for name in values}
        for layer, values in trained.items()
    }


# Batches, made beside the training.


class _BatchPrefetcher:
    """Batches from a step on, made ahead by a thread; without a limit on time a batch depends on seed and step alone.

    `share` is how much of the training is over; what it decides, pieces or whole pictures, holds a few steps later.
    """

    def __init__(
        self, data: DetectionDataset, recipe: NetworkTrainingOptions, per_epoch: int, first: int, share: float
    ) -> None:
        self.progress = share
        self._data, self._recipe, self._per_epoch, self._step = data, recipe, per_epoch, first
        self._made: queue.Queue[Batch] = queue.Queue(maxsize=4)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def next(self) -> Batch:
        """The batch of the next step."""
        while True:
            try:
                return self._made.get(timeout=10.0)
            except queue.Empty:
                if not self._thread.is_alive():
                    raise RuntimeError("the making of batches has ended") from None

    def _run(self) -> None:
        while not self._ended.is_set():
            made = self._prepare(self._step)
            self._step += 1
            while not self._ended.is_set():
                try:
                    self._made.put(made, timeout=0.2)
                    break
                except queue.Full:
                    continue

    def _prepare(self, step: int) -> Batch:
        share = step / (self._recipe.epochs * self._per_epoch)
        if self._recipe.limit_s is not None:
            share = max(share, self.progress)
        numbers = image_indices(len(self._data), self._recipe, self._per_epoch, step)
        rng = np.random.default_rng([self._recipe.seed, 1, step])
        return augment_batch(self._data, numbers, rng, crops=share < self._recipe.pieces_share)

    def __enter__(self) -> "_BatchPrefetcher":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()


def image_indices(count: int, options: NetworkTrainingOptions, per_epoch: int, step: int) -> np.ndarray:
    """Numbers of the pictures of a step; a pass shows every picture once."""
    epoch, place = divmod(step, per_epoch)
    order = np.random.default_rng([options.seed, 0, epoch]).permutation(count)
    return order[place * options.batch : (place + 1) * options.batch]


# Weights.


def with_channel_gains(params: Params) -> Params:
    """What is trained: the parameters, and for every convolution but the last a gain for each channel."""
    gains = {
        layer: {"gain": _channel_norm(values["kernel"])} for layer, values in params.items() if layer != _OUTPUT_LAYER
    }
    return {layer: {**values, **gains.get(layer, {})} for layer, values in params.items()}


def _channel_norm(kernel: jax.Array) -> jax.Array:
    """Length of every channel of a kernel, less its mean."""
    centered = kernel - jnp.mean(kernel, axis=(0, 1, 2), keepdims=True)
    return jnp.sqrt(jnp.sum(centered**2, axis=(0, 1, 2)) + 1e-8)


def apply_channel_gains(trained: Params) -> Params:
    """The network's parameters: kernels of zero mean and of the length that the gain says."""
    return {
        layer: {"kernel": _standardized_kernel(values), "bias": values["bias"]} for layer, values in trained.items()
    }


def _standardized_kernel(values: dict[str, jax.Array]) -> jax.Array:
    kernel = values["kernel"]
    if "gain" not in values:
        return kernel
    centered = kernel - jnp.mean(kernel, axis=(0, 1, 2), keepdims=True)
    return centered / _channel_norm(kernel)[None, None, None, :] * values["gain"][None, None, None, :]


def _training_digest(data: DetectionDataset, options: NetworkTrainingOptions, weights: Any) -> str:
    """What tells this training from others."""
    digest = hashlib.sha256(repr((dataclasses.replace(options, limit_s=None), len(data))).encode())
    for leaf in jax.tree.leaves(weights):
        digest.update(np.asarray(leaf).tobytes())
    digest.update(data.images[:: max(1, len(data) // 50)].tobytes())
    digest.update(np.concatenate(data.boxes).tobytes())
    return digest.hexdigest()
