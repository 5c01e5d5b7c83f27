"""Training of the detector: focal loss on heat, GIoU and distance loss on edges, a running mean of the weights.

Two things make it quick on a CPU. The first part of the training sees pieces of the pictures, at a quarter of the cost.
And kernels are learnt as a direction and a gain for each channel (Brock et al., "Characterizing signal propagation to
close the performance gap in unnormalized ResNets", ICLR 2021), which does for convergence what a normalisation would;
the weights that are written are the products, and the network that flies has no trace of it.
"""

import dataclasses
import hashlib
import queue
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from rpojax.training import detector_judge
from rpojax.training.augment import Batch, batch
from rpojax.training.detection_data import Dataset
from rpojax.training.orthogonal import scale_by_orthogonal
from rpojax.vision.detector import NETWORK, STRIDE, Params, fresh, to_maps
from rpojax.vision.weights import WeightsError, read_tensors, write_tensors

_DECAY = 0.999
_SPREAD = 0.12
_LEAST_SPREAD_PX = 2.0
_NEAR = 0.3
_GAIN = 1.4
_LAST = "out"
_MOMENTUM = 0.9
_KERNEL_RATE = 10.0
"""Rate of kernels by that of the rest."""
_PIECES_SHARE = 0.5
"""Part of the training that sees pieces of pictures."""


@dataclasses.dataclass(frozen=True)
class Recipe:
    """How a detector is trained: passes over the data, pictures a step, seed, largest rate, wall-clock limit [s]."""

    epochs: int = 100
    batch: int = 32
    seed: int = 0
    rate: float = 5e-3
    limit_s: float | None = None


@dataclasses.dataclass(frozen=True)
class Step:
    """How far training is: step of so many, figures on held-out pictures, seconds so far."""

    done: int
    total: int
    map50: float
    map50_95: float
    elapsed_s: float


OnStep = Callable[[Step], None]


@dataclasses.dataclass(frozen=True)
class State:
    """What training carries: weights, their running mean, and the optimiser's state."""

    params: Params
    mean: Params
    optimiser: Any


def train(
    data: Dataset,
    held_out: Dataset,
    recipe: Recipe,
    checkpoint: Path | None = None,
    on_step: OnStep = lambda step: None,
) -> tuple[Params, list[Step]]:
    """Trains on a data set and returns the running mean of the weights with the history of checks on another one.

    With a checkpoint an interrupted call goes on after the last finished pass, to the same result. A limit shortens
    the schedule: the rate has fallen to its end when the time is over.
    """
    begin = time.monotonic()
    per_epoch = max(1, len(data) // recipe.batch)
    total = recipe.epochs * per_epoch
    params = unfolded(fresh(jax.random.key(recipe.seed)))
    optimiser = _optimiser()
    state = State(params, params, optimiser.init(params))
    history: list[Step] = []
    done, share = 0, 0.0
    key = _digest(data, recipe)
    if checkpoint and (found := _read(checkpoint, key, state)):
        state, done, share, before = found
        begin -= before
    with _Prepared(data, recipe, per_epoch, done) as prepared:
        while done < total and share < 1.0:
            prepared.share = share
            for _ in range(per_epoch):
                rate = recipe.rate * _schedule(share, done)
                made = prepared.next()
                state = State(
                    *_advance(
                        optimiser,
                        state.params,
                        state.mean,
                        state.optimiser,
                        jnp.asarray(rate, jnp.float32),
                        jnp.asarray(min(_DECAY, (1.0 + done) / (10.0 + done)), jnp.float32),
                        jnp.asarray(made.images),
                        jnp.asarray(made.boxes),
                        jnp.asarray(made.weight),
                    )
                )
                done += 1
                share = _share(done, total, time.monotonic() - begin, recipe.limit_s)
                if share >= 1.0:
                    break
            elapsed = time.monotonic() - begin
            found = detector_judge.figures(detector_judge.find(folded(state.mean), held_out.images), held_out)
            history.append(Step(done, total, found["map50"] or 0.0, found["map50_95"] or 0.0, elapsed))
            if checkpoint:
                _write(checkpoint, key, state, done, share, elapsed)
            on_step(history[-1])
    return folded(state.mean), history


def _share(done: int, total: int, elapsed_s: float, limit_s: float | None) -> float:
    """How much of the training is over, by steps or by time."""
    return max(done / total, 0.0 if limit_s is None else elapsed_s / limit_s)


def _schedule(share: float, done: int) -> float:
    """Rate by its largest: a rise over 200 steps, then half a cosine down to a hundredth."""
    return min(1.0, (done + 1) / 200.0) * (0.505 + 0.495 * float(np.cos(np.pi * min(share, 1.0))))


def _optimiser() -> optax.GradientTransformation:
    """Orthogonal steps for kernels, Adam for the rest. The rate is applied outside, so that it may follow the clock."""
    rest = optax.scale_by_adam(b2=0.99, eps=1e-7)
    kernels = optax.chain(scale_by_orthogonal(_MOMENTUM), optax.scale(_KERNEL_RATE))
    return optax.chain(optax.clip_by_global_norm(5.0), optax.multi_transform({"kernel": kernels, "rest": rest}, _sorts))


def _sorts(trained: Params) -> dict[str, dict[str, str]]:
    """Which way of stepping each array takes."""
    return {
        layer: {name: "kernel" if name == "kernel" and layer != _LAST else "rest" for name in values}
        for layer, values in trained.items()
    }


# Batches, made beside the training.


class _Prepared:
    """Batches from a step on, made ahead by a thread; without a limit on time a batch depends on seed and step alone.

    `share` is how much of the training is over; what it decides, pieces or whole pictures, holds a few steps later.
    """

    def __init__(self, data: Dataset, recipe: Recipe, per_epoch: int, first: int) -> None:
        self.share = 0.0
        self._data, self._recipe, self._per_epoch, self._step = data, recipe, per_epoch, first
        self._made: queue.Queue[Batch] = queue.Queue(maxsize=4)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._make, daemon=True)

    def next(self) -> Batch:
        """The batch of the next step."""
        while True:
            try:
                return self._made.get(timeout=10.0)
            except queue.Empty:
                if not self._thread.is_alive():
                    raise RuntimeError("the making of batches has ended") from None

    def _make(self) -> None:
        while not self._ended.is_set():
            made = self._one(self._step)
            self._step += 1
            while not self._ended.is_set():
                try:
                    self._made.put(made, timeout=0.2)
                    break
                except queue.Full:
                    continue

    def _one(self, step: int) -> Batch:
        share = step / (self._recipe.epochs * self._per_epoch)
        if self._recipe.limit_s is not None:
            share = max(share, self.share)
        numbers = chosen(len(self._data), self._recipe, self._per_epoch, step)
        rng = np.random.default_rng([self._recipe.seed, 1, step])
        return batch(self._data, numbers, rng, pieces=share < _PIECES_SHARE)

    def __enter__(self) -> "_Prepared":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()


def chosen(count: int, recipe: Recipe, per_epoch: int, step: int) -> np.ndarray:
    """Numbers of the pictures of a step; a pass shows every picture once."""
    epoch, place = divmod(step, per_epoch)
    order = np.random.default_rng([recipe.seed, 0, epoch]).permutation(count)
    return order[place * recipe.batch : (place + 1) * recipe.batch]


# Weights.


def unfolded(params: Params) -> Params:
    """What is trained: the parameters, and for every convolution but the last a gain for each channel."""
    gains = {
        layer: {"gain": jnp.full((values["kernel"].shape[-1],), _GAIN, jnp.float32)}
        for layer, values in params.items()
        if layer != _LAST
    }
    return {layer: {**values, **gains.get(layer, {})} for layer, values in params.items()}


def folded(trained: Params) -> Params:
    """The network's parameters: kernels of zero mean and of the length that the gain says."""
    return {layer: {"kernel": _kernel(values), "bias": values["bias"]} for layer, values in trained.items()}


def _kernel(values: dict[str, jax.Array]) -> jax.Array:
    kernel = values["kernel"]
    if "gain" not in values:
        return kernel
    centered = kernel - jnp.mean(kernel, axis=(0, 1, 2), keepdims=True)
    length = jnp.sqrt(jnp.sum(centered**2, axis=(0, 1, 2), keepdims=True) + 1e-8)
    return centered / length * values["gain"][None, None, None, :]


# Loss.


@partial(jax.jit, static_argnums=0)
def _advance(
    optimiser: optax.GradientTransformation,
    params: Params,
    mean: Params,
    state: Any,
    rate: jax.Array,
    decay: jax.Array,
    images: jax.Array,
    boxes: jax.Array,
    weight: jax.Array,
) -> tuple[Params, Params, Any]:
    """One step."""
    slope = jax.grad(lambda p: loss(NETWORK.apply({"params": folded(p)}, images), boxes, weight))(params)  # pyright: ignore[reportArgumentType]
    with jax.numpy_dtype_promotion("standard"):  # optax raises a number to the power of its count
        change, state = optimiser.update(slope, state, params)
    params = jax.tree.map(lambda p, c: p - rate * c, params, change)
    mean = jax.tree.map(lambda m, p: decay * m + (1.0 - decay) * p, mean, params)
    return params, mean, state


def loss(raw: jax.Array, boxes: jax.Array, weight: jax.Array) -> jax.Array:
    """Loss of the network's channels (n, y, x, 5) for boxes (n, m, 4) [px] with weights (n, m) as in `Batch`."""
    maps = to_maps(raw)
    heat, edges = jax.vmap(_picture_loss)(maps.heat, maps.edges, raw[..., 1:], boxes, weight)
    count = jnp.maximum(jnp.sum(jnp.where(weight > 0.0, 1.0, 0.0).astype(jnp.float32)), 1.0)
    return (jnp.sum(heat) + 2.0 * jnp.sum(edges)) / count


def _picture_loss(
    heat: jax.Array, edges: jax.Array, raw: jax.Array, boxes: jax.Array, weight: jax.Array
) -> tuple[jax.Array, jax.Array]:
    rows, columns = heat.shape
    x = ((jnp.arange(columns, dtype=jnp.float32) + 0.5) * STRIDE)[None, :]
    y = ((jnp.arange(rows, dtype=jnp.float32) + 0.5) * STRIDE)[None, :]
    left, top, right, bottom = (boxes[:, i, None] for i in range(4))
    # One axis at a time (m, cells): a bell, the cell that holds the middle, and the cells that the box covers.
    bells, middles, covers = [], [], []
    for place, low, high in ((x, left, right), (y, top, bottom)):
        off = place - 0.5 * (low + high)
        spread = jnp.maximum(_SPREAD * (high - low), _LEAST_SPREAD_PX)
        bells.append(jnp.exp(-0.5 * (off / spread) ** 2))
        middles.append((off >= -0.5 * STRIDE) & (off < 0.5 * STRIDE))
        covers.append((place > low - STRIDE) & (place < high + STRIDE))
    learnt, unsure = (weight > 0.0)[:, None, None], (weight < 0.0)[:, None, None]
    near = jnp.where(learnt, bells[1][:, :, None] * bells[0][:, None, :], 0.0)
    inside = middles[1][:, :, None] & middles[0][:, None, :] & learnt
    positive = jnp.any(inside, axis=0)
    skipped = jnp.any(covers[1][:, :, None] & covers[0][:, None, :] & unsure, axis=0) & ~positive
    target = jnp.max(near, axis=0)
    heat_loss = jnp.where(skipped, 0.0, _focal(heat, target, positive))
    # Each cell learns the edges of the one box whose middle it is nearest to.
    near = jnp.where(inside, 1.0, near)
    owner = jax.nn.one_hot(jnp.argmax(near, axis=0), boxes.shape[0], axis=0, dtype=jnp.float32)
    pull = owner * jnp.where(near >= _NEAR, near, 0.0)
    pull = jnp.sum(pull / jnp.maximum(jnp.sum(pull, axis=(1, 2), keepdims=True), 1e-6), axis=0)
    wanted = jnp.einsum("myx,mc->yxc", owner, boxes)
    middle = jnp.stack(jnp.broadcast_arrays(x, y.T, x, y.T), axis=-1)
    sign = jnp.array([-1.0, -1.0, 1.0, 1.0], jnp.float32)[None, None, :]
    distance = jnp.mean(jnp.abs(raw - jnp.arcsinh(sign * (wanted - middle) / STRIDE)), axis=-1)
    edge_loss = (1.0 - _giou(edges, wanted)) + distance
    return jnp.sum(heat_loss), jnp.sum(pull * edge_loss)


def _focal(logit: jax.Array, target: jax.Array, positive: jax.Array) -> jax.Array:
    """Focal loss of heat: full weight on middles, less on wrong heat the nearer it is to one."""
    p = jax.nn.sigmoid(logit)
    right = -((1.0 - p) ** 2) * jax.nn.log_sigmoid(logit)
    wrong = -((1.0 - target) ** 4) * p * p * jax.nn.log_sigmoid(-logit)
    return jnp.where(positive, right, wrong)


def _giou(a: jax.Array, b: jax.Array) -> jax.Array:
    """Generalised intersection over union of boxes (..., 4) (Rezatofighi et al., CVPR 2019)."""
    low, high = jnp.maximum(a[..., :2], b[..., :2]), jnp.minimum(a[..., 2:], b[..., 2:])
    both = jnp.prod(jnp.maximum(high - low, 0.0), axis=-1)
    sides_a, sides_b = jnp.maximum(a[..., 2:] - a[..., :2], 0.0), b[..., 2:] - b[..., :2]
    either = jnp.prod(sides_a, axis=-1) + jnp.prod(sides_b, axis=-1) - both
    hull = jnp.maximum(a[..., 2:], b[..., 2:]) - jnp.minimum(a[..., :2], b[..., :2])
    around = jnp.maximum(jnp.prod(hull, axis=-1), 1e-6)
    return both / jnp.maximum(either, 1e-6) - (around - either) / around


# Checkpoints.


def _digest(data: Dataset, recipe: Recipe) -> str:
    digest = hashlib.sha256(repr((dataclasses.replace(recipe, limit_s=None), len(data))).encode())
    digest.update(data.images[:: max(1, len(data) // 50)].tobytes())
    digest.update(np.concatenate(data.boxes).tobytes())
    return digest.hexdigest()


def _write(path: Path, key: str, state: State, done: int, share: float, elapsed_s: float) -> None:
    content = (state.params, state.mean, state.optimiser)
    leaves = {f"{index:04d}": np.asarray(leaf) for index, leaf in enumerate(jax.tree.leaves(content))}
    metadata = {"key": key, "done": str(done), "share": str(share), "elapsed_s": str(elapsed_s)}
    write_tensors(path, leaves, metadata)


def _read(path: Path, key: str, like: State) -> tuple[State, int, float, float] | None:
    """State, steps done, share of the schedule and seconds so far, or None where there is no such checkpoint."""
    if not path.is_file():
        return None
    try:
        tensors, metadata = read_tensors(path)
    except WeightsError:
        return None
    leaves, structure = jax.tree.flatten((like.params, like.mean, like.optimiser))
    found = [tensors.get(f"{index:04d}") for index in range(len(leaves))]
    if metadata.get("key") != key or any(
        f is None or f.shape != leaf.shape or f.dtype != leaf.dtype for f, leaf in zip(found, leaves, strict=True)
    ):
        return None
    state = State(*jax.tree.unflatten(structure, [jnp.asarray(values) for values in found]))
    return state, int(metadata["done"]), float(metadata["share"]), float(metadata["elapsed_s"])


def card(
    data: Dataset, recipe: Recipe, history: list[Step], figures: Mapping[str, Any], command: str
) -> dict[str, Any]:
    """What to say about a detector: how it was made, and its figures on pictures held out."""
    return {
        "images": len(data),
        "size_px": int(data.images.shape[1]),
        "recipe": dataclasses.asdict(recipe),
        "steps_done": history[-1].done if history else 0,
        "training_s": round(history[-1].elapsed_s, 1) if history else None,
        "held_out": dict(figures),
        "command": command,
    }
