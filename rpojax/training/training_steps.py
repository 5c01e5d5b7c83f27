"""Steps of the training of a network: Muon, averaged weights, and batches that are prepared ahead.

Muon optimiser: steps along the orthogonalised momentum of a kernel.

Jordan et al., "Muon: an optimizer for hidden layers in neural networks", 2024. On these networks it needs far fewer
steps than Adam.

Weight standardisation with a gain per channel, used in training in place of normalisation layers.

After Brock et al., "Characterizing signal propagation to close the performance gap in unnormalized ResNets", ICLR 2021.
The products are what is stored, so that inference has no such step.
"""

import collections
import dataclasses
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from rpojax.runtime.jax_environment import available_cores

_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
"""Of the odd polynomial of a Newton-Schulz step; five steps take singular values in 0.01..1 to near one."""
_ITERATIONS = 5
_OUTPUT_PREFIX = "out"
_MAX_THREADS = 8
AVERAGE_DECAY = 0.999
_MOMENTUM = 0.9
_KERNEL_RATE_FACTOR = 10.0
"""Learning rate of kernels by that of the other arrays."""
Params = dict[str, Any]
"""Arrays of one network by layer and name."""
Batch = TypeVar("Batch")
Loss = Callable[[Params, Any, jax.Array, Any], jax.Array]
"""Of a network's parameters, frozen parameters, a random key and a batch."""


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


class BatchPrefetcher(Generic[Batch]):
    """Batches from a step on, in order; `prepare` makes that of a step, given the fraction of the training done.

    Without a time limit a batch is to depend on its step alone; with one, `progress` may run ahead of the steps. As
    many threads prepare batches as there are cores, so that an accelerator does not wait for one.
    """

    def __init__(self, prepare: Callable[[int, float], Batch], first_step: int, progress: float) -> None:
        self.progress = progress
        self._prepare, self._step = prepare, first_step
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

    def __enter__(self) -> "BatchPrefetcher[Batch]":
        self._executor = ThreadPoolExecutor(self._threads, thread_name_prefix="augmentation")
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)


@dataclasses.dataclass(frozen=True)
class TrainingState:
    """Trained arrays, their exponential moving average, and the state of the optimiser."""

    params: Params
    averaged_params: Params
    optimizer_state: Any

    def arrays(self) -> tuple[Params, Params, Any]:
        """All arrays, in the order of the constructor."""
        return self.params, self.averaged_params, self.optimizer_state


def first_state(start: Params) -> TrainingState:
    """State before the first step of a training from given parameters."""
    params = with_channel_gains(start)
    return TrainingState(params, params, optimizer().init(params))


@partial(jax.jit, static_argnums=(0, 1))
def training_step(
    loss: Loss,
    optimizer: optax.GradientTransformation,
    state: tuple[Params, Params, Any],
    frozen: Any,
    settings: jax.Array,
    key: jax.Array,
    batch: Any,
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


def learning_rate_factor(progress: float, done: int) -> float:
    """Learning rate by its peak: linear warm-up over 200 steps, then half a cosine down to a hundredth."""
    return min(1.0, (done + 1) / 200.0) * (0.505 + 0.495 * float(np.cos(np.pi * min(progress, 1.0))))


def optimizer() -> optax.GradientTransformation:
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


def step_settings(rate: float, progress: float, done: int) -> jax.Array:
    """Settings of `training_step` from the peak learning rate, and the fraction of the training and the steps done."""
    average_decay = min(AVERAGE_DECAY, (1.0 + done) / (10.0 + done))
    return jnp.asarray([rate * learning_rate_factor(progress, done), average_decay], jnp.float32)
