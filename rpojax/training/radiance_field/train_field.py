"""Training of a radiance field on ray-traced views."""

import dataclasses
import hashlib
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import optax

from rpojax.core.pytree import replace
from rpojax.training import checkpoint as checkpoints
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.vision.imaging.srgb import linear_to_srgb
from rpojax.vision.pinhole import pixel_directions
from rpojax.vision.radiance_field.grid_field import GridField
from rpojax.vision.radiance_field.initial_grid import initialize_grid
from rpojax.vision.radiance_field.nerf_field import initialize_nerf
from rpojax.vision.radiance_field.occupancy_sampling import with_occupancy
from rpojax.vision.radiance_field.target_field import RadianceField, render_rays

_MARGIN_PX = 3
"""Distance from the silhouette up to which empty pixels are used."""
_ALPHA_WEIGHT = 0.5
_FILL_WEIGHT = 0.3
"""Weight of errors under fill light, which is at most a quarter of the Sun's."""
_CODE_SLOPE = 1.055 / 2.4
"""Slope of an sRGB code at white."""
_NEIGHBOUR_PAIRS = 8192
_SMOOTHNESS = 1e-2
_STEPS_PER_CHUNK = 50
_STEPS_PER_CHECK = 250
_LEARNING_RATES = {
    "raw_density": 0.03,
    "features": 0.02,
    "network": 3e-3,
    "material": 1e-2,
    "fill_network": 3e-3,
    "trunk": 2e-3,
    "head": 2e-3,
}
_ADAM = optax.scale_by_adam(b2=0.99, eps=1e-10)
_VALIDATION_VIEWS = 12
_VALIDATION_RAYS = 16_384


class TrainingRays(NamedTuple):
    """Camera position (v, 3) [m] and lights (v, 3) of the views; view (n,), direction (n, 3), codes, alpha of the rays.

    Positions and directions are in T, colours (n, 3) under the Sun and fill light are codes of `radiance_code`.
    """

    position: jax.Array
    sun: jax.Array
    fill: jax.Array
    view: jax.Array
    direction: jax.Array
    sunlit: jax.Array
    filled: jax.Array
    alpha: jax.Array


def training_rays(views: Views, first: int, last: int) -> TrainingRays:
    """Rays of the views from `first` up to `last`."""
    size = views.alpha.shape[1]
    disc = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
    direction_K = pixel_directions(size, views.field_of_view_deg)
    view, direction, sunlit, filled, alpha = [], [], [], [], []
    for index in range(first, last):
        near = cv2.dilate((views.alpha[index] > 0.0).astype(np.uint8), disc) > 0
        view.append(np.full(int(near.sum()), index - first, np.int32))
        direction.append((direction_K[near] @ views.rotation[index]).astype(np.float32))
        sunlit.append(views.sunlit[index][near])
        filled.append(views.filled[index][near])
        alpha.append(views.alpha[index][near].astype(np.float32))
    position, sun, fill = (
        jnp.asarray(values[first:last], jnp.float32) for values in (views.position, views.sun, views.fill)
    )
    merged = [jnp.asarray(np.concatenate(values)) for values in (view, direction, sunlit, filled, alpha)]
    return TrainingRays(
        position=position,
        sun=sun,
        fill=fill,
        view=merged[0],
        direction=merged[1],
        sunlit=radiance_code(merged[2].astype(jnp.float32)),
        filled=radiance_code(merged[3].astype(jnp.float32)),
        alpha=merged[4],
    )


def radiance_code(linear: jax.Array) -> jax.Array:
    """sRGB codes of linear radiance up to white, continued with the same slope by a logarithm above it."""
    return linear_to_srgb(linear) + _CODE_SLOPE * jnp.log(jnp.maximum(linear, 1.0))


def subsample(rays: TrainingRays, count: int) -> TrainingRays:
    """About `count` of the rays, evenly spaced."""
    step = max(1, len(rays.view) // count)
    return TrainingRays(*rays[:3], *(values[::step] for values in rays[3:]))


def field_loss(
    field: RadianceField, rays: TrainingRays, chosen: jax.Array, jitter: jax.Array, neighbours: jax.Array
) -> jax.Array:
    """Loss over the chosen rays (n,), with `jitter` (n,) of their samples, and over pairs of neighbouring nodes."""
    color, alpha = mean_squared_errors(field, rays, chosen, jitter)
    return color + _ALPHA_WEIGHT * alpha + _smoothness_penalty(field, neighbours)


def mean_squared_errors(
    field: RadianceField, rays: TrainingRays, chosen: jax.Array, jitter: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Mean squared errors of codes, and of alpha, over the chosen rays."""
    view = rays.view[chosen]
    rendered = render_rays(field, rays.position[view], rays.direction[chosen], rays.sun[view], rays.fill[view], jitter)
    sunlit = jnp.mean((radiance_code(rendered.sunlit) - rays.sunlit[chosen]) ** 2)
    filled = jnp.mean((radiance_code(rendered.filled) - rays.filled[chosen]) ** 2)
    return sunlit + _FILL_WEIGHT * filled, jnp.mean((rendered.alpha - rays.alpha[chosen]) ** 2)


@jax.jit
def validation_error(field: RadianceField, rays: TrainingRays) -> jax.Array:
    """Mean squared error of sRGB codes over all rays, in parts of 1024."""
    part = min(1024, rays.view.shape[0])
    count = rays.view.shape[0] // part * part
    parts = jnp.arange(count, dtype=jnp.int32).reshape(-1, part)
    zero = jnp.zeros((part,), jnp.float32)
    return jnp.mean(jax.lax.map(lambda chosen: mean_squared_errors(field, rays, chosen, zero)[0], parts))


def random_neighbours(field: RadianceField, nodes: jax.Array, key: jax.Array) -> jax.Array:
    """Table rows (n, 2) of random pairs of neighbouring nodes; a pair with an empty node is (0, 0)."""
    if not isinstance(field, GridField):
        return jnp.zeros((1, 2), jnp.int32)
    limits = jnp.array(field.node_row.shape, jnp.int32)[None, :]
    place = nodes[jax.random.randint(key, (_NEIGHBOUR_PAIRS,), 0, nodes.shape[0], jnp.int32)]
    axis = jax.random.randint(jax.random.fold_in(key, 1), (_NEIGHBOUR_PAIRS,), 0, 3, jnp.int32)
    other = jnp.minimum(place + jnp.eye(3, dtype=jnp.int32)[axis], limits - 1)
    rows = jnp.stack([field.node_row[p[:, 0], p[:, 1], p[:, 2]] for p in (place, other)], axis=1)
    return jnp.where(jnp.any(rows == 0, axis=1, keepdims=True), 0, rows)


def _smoothness_penalty(field: RadianceField, neighbours: jax.Array) -> jax.Array:
    """Weighted mean squared difference of the latent features of neighbouring nodes."""
    if not isinstance(field, GridField):
        return jnp.zeros((), jnp.float32)
    pair = field.features[neighbours]
    return _SMOOTHNESS * jnp.mean((pair[:, 0] - pair[:, 1])[:, 3:] ** 2)


def trained_weights(field: RadianceField) -> dict[str, Any]:
    """Trained arrays of a field by name."""
    names = (
        ("raw_density", "features", "network", "material", "fill_network")
        if isinstance(field, GridField)
        else ("trunk", "head")
    )
    return {name: getattr(field, name) for name in names}


@dataclasses.dataclass(frozen=True)
class FieldTrainingOptions:
    """Options of a training.

    Attributes:
        steps: most steps, in chunks of 50
        rays: rays per step
        seed: seed of all random numbers
        kind: 'grid', or 'point' for the NeRF
        limit_s: wall-clock limit [s]
        patience: checks, every 250 steps, without a gain of `gain_db` that end the training
        gain_db: least gain of a check [dB]
        rows: most nodes of a grid
    """

    steps: int = 5000
    rays: int = 2048
    seed: int = 0
    kind: str = "grid"
    limit_s: float | None = None
    patience: int = 3
    gain_db: float = 0.02
    rows: int = 160_000


@dataclasses.dataclass(frozen=True)
class FieldTrainingProgress:
    """Progress of a training: steps done of how many, PSNR on validation views [dB], elapsed time [s]."""

    done: int
    total: int
    psnr_db: float
    elapsed_s: float


OnFieldProgress = Callable[[FieldTrainingProgress], None]


@dataclasses.dataclass(frozen=True)
class _TrainingState:
    """Field and state of the optimiser, progress at the checks, best PSNR [dB], and checks since it was gained."""

    field: RadianceField
    optimizer_state: Any
    history: tuple[FieldTrainingProgress, ...] = ()
    best_db: float = -np.inf
    checks_without_gain: int = 0

    @property
    def done(self) -> int:
        return self.history[-1].done if self.history else 0


def initialize_field(mesh: TargetMesh, options: FieldTrainingOptions) -> RadianceField:
    """An untrained field for a mesh."""
    key = jax.random.key(options.seed)
    low, high = mesh.bounds
    if options.kind == "point":
        margin = 0.02 * (high - low).max()
        return initialize_nerf(low - margin, high + margin, key)
    points, normals = mesh.surface_points(float((high - low).max()) / 250.0)
    return initialize_grid(points, normals, key, options.rows)


def train(
    mesh: TargetMesh,
    views: Views,
    options: FieldTrainingOptions,
    checkpoint: Path | None = None,
    on_progress: OnFieldProgress = lambda progress: None,
) -> tuple[RadianceField, list[FieldTrainingProgress]]:
    """A field trained on all but a few of the views, and its progress; continues from a checkpoint of this training."""
    start_time = time.monotonic()
    field = initialize_field(mesh, options)
    validation_views = min(_VALIDATION_VIEWS, len(views) // 8)
    rays = training_rays(views, 0, len(views) - validation_views)
    validation_rays = subsample(training_rays(views, len(views) - validation_views, len(views)), _VALIDATION_RAYS)
    nodes = jnp.asarray(
        np.argwhere(np.asarray(field.node_row) > 0) if isinstance(field, GridField) else [[0]], jnp.int32
    )
    state = _TrainingState(field, _ADAM.init(trained_weights(field)))
    key = _training_digest(mesh, views, options)
    state = _read_checkpoint(checkpoint, key, state) if checkpoint else state
    start_time -= state.history[-1].elapsed_s if state.history else 0.0
    is_late = False
    while (
        state.done + _STEPS_PER_CHUNK <= options.steps and state.checks_without_gain < options.patience and not is_late
    ):
        done, field, optimizer_state = state.done, state.field, state.optimizer_state
        is_due = False
        while not is_due:
            field, optimizer_state = _run_chunk_at(options, done, field, optimizer_state, rays, nodes)
            done += _STEPS_PER_CHUNK
            is_late = options.limit_s is not None and time.monotonic() - start_time > options.limit_s
            is_due = not done % _STEPS_PER_CHECK or done + _STEPS_PER_CHUNK > options.steps or is_late
        state = _check(
            state, _with_current_occupancy(field), optimizer_state, validation_rays, options, done, start_time
        )
        if checkpoint:
            _write_checkpoint(checkpoint, key, state)
        on_progress(state.history[-1])
    return state.field, list(state.history)


def _check(
    state: _TrainingState,
    field: RadianceField,
    optimizer_state: Any,
    validation_rays: TrainingRays,
    options: FieldTrainingOptions,
    done: int,
    start_time: float,
) -> _TrainingState:
    """The state with a trained field, after a check of its PSNR."""
    error = float(validation_error(field, validation_rays))
    # Steps run asynchronously: the time is that of their result.
    elapsed = time.monotonic() - start_time
    psnr_db = float(-10.0 * np.log10(error))
    return _TrainingState(
        field,
        optimizer_state,
        (*state.history, FieldTrainingProgress(done, options.steps, psnr_db, elapsed)),
        max(state.best_db, psnr_db),
        0 if psnr_db > state.best_db + options.gain_db else state.checks_without_gain + 1,
    )


def _write_checkpoint(path: Path, key: str, state: _TrainingState) -> None:
    last = dataclasses.asdict(state.history[-1])
    progress = {"last": last, "best": state.best_db, "since": state.checks_without_gain}
    checkpoints.write_checkpoint(path, key, (trained_weights(state.field), state.optimizer_state), progress)


def _read_checkpoint(path: Path, key: str, state: _TrainingState) -> _TrainingState:
    """The state of a checkpoint, or `state` without one."""
    found = checkpoints.read_checkpoint(path, key, (trained_weights(state.field), state.optimizer_state))
    if found is None:
        return state
    (weights, optimizer_state), progress = found
    field = _with_current_occupancy(replace(state.field, **weights))
    last = FieldTrainingProgress(**progress["last"])
    return _TrainingState(field, optimizer_state, (last,), progress["best"], progress["since"])


def _with_current_occupancy(field: RadianceField) -> RadianceField:
    """The field with the occupancy, if it has one, of its present density."""
    return with_occupancy(field) if isinstance(field, GridField) else field


def _run_chunk_at(
    options: FieldTrainingOptions,
    done: int,
    field: RadianceField,
    optimizer_state: Any,
    rays: TrainingRays,
    nodes: jax.Array,
) -> tuple[RadianceField, Any]:
    """A chunk of steps from step `done` on."""
    key = jax.random.fold_in(jax.random.key(options.seed), done)
    progress = (done + jnp.arange(_STEPS_PER_CHUNK, dtype=jnp.float32)) / options.steps
    return _run_chunk(options.rays, field, optimizer_state, rays, nodes, key, progress)


@partial(jax.jit, static_argnums=(0,))
def _run_chunk(
    batch: int,
    field: RadianceField,
    optimizer_state: Any,
    rays: TrainingRays,
    nodes: jax.Array,
    key: jax.Array,
    progress: jax.Array,
) -> tuple[RadianceField, Any]:
    """A chunk of steps, each at its fraction of the training; compiled once for any number of steps."""

    def loss(weights: dict[str, Any], chosen: jax.Array, jitter: jax.Array, neighbours: jax.Array) -> jax.Array:
        return field_loss(replace(field, **weights), rays, chosen, jitter, neighbours)

    def step(carry: Any, now: tuple[jax.Array, jax.Array]) -> tuple[Any, None]:
        (weights, optimizer_state), (key, step_progress) = carry, now
        chosen = jax.random.randint(key, (batch,), 0, rays.view.shape[0], jnp.int32)
        jitter = jax.random.uniform(jax.random.fold_in(key, 1), (batch,), jnp.float32, -0.5, 0.5)
        neighbours = random_neighbours(field, nodes, jax.random.fold_in(key, 2))
        gradient = jax.grad(loss)(weights, chosen, jitter, neighbours)
        if "raw_density" in gradient:
            # Row 0 stays empty, and the normals stay those of the mesh.
            gradient["raw_density"] = gradient["raw_density"].at[0].set(0.0)
            gradient["features"] = gradient["features"].at[:, :3].set(0.0)
        with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer power
            update, optimizer_state = _ADAM.update(gradient, optimizer_state)
        weights = optax.apply_updates(weights, _scale_by_learning_rates(update, step_progress))
        return (weights, optimizer_state), None

    start = (trained_weights(field), optimizer_state)
    (weights, optimizer_state), _ = jax.lax.scan(step, start, (jax.random.split(key, _STEPS_PER_CHUNK), progress))
    return replace(field, **weights), optimizer_state


def _scale_by_learning_rates(update: Any, progress: jax.Array) -> dict[str, Any]:
    """Updates times the learning rates of their arrays, which fall along a cosine with the progress."""
    fall = 0.515 + 0.485 * jnp.cos(jnp.pi * jnp.minimum(progress, 1.0))
    rates = {name: -rate * fall for name, rate in _LEARNING_RATES.items()}
    return {name: jax.tree.map(partial(jnp.multiply, rates[name]), part) for name, part in update.items()}


def _training_digest(mesh: TargetMesh, views: Views, options: FieldTrainingOptions) -> str:
    """Key of a training for its checkpoint."""
    digest = hashlib.sha256(repr((mesh.name, dataclasses.replace(options, limit_s=None), len(views))).encode())
    for values in (mesh.vertices, views.position, views.sun, views.sunlit.sum(axis=(1, 2, 3))):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def model_card(
    mesh: TargetMesh, views: Views, options: FieldTrainingOptions, history: list[FieldTrainingProgress], command: str
) -> Mapping[str, object]:
    """Model card of a field: mesh, options and duration of its training, and PSNR on validation views."""
    return {
        "target": mesh.name,
        "faces": mesh.face_count,
        "views": len(views),
        "view_size_px": int(views.alpha.shape[1]),
        "recipe": dataclasses.asdict(options),
        "steps_done": history[-1].done if history else 0,
        "held_out_psnr_near_target_db": round(history[-1].psnr_db, 2) if history else None,
        "training_s": round(history[-1].elapsed_s, 1) if history else None,
        "command": command,
    }
