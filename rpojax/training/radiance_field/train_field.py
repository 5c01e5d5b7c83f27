"""Training of a field on ray-traced views."""

import dataclasses
import hashlib
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from rpojax.core.pytree import replace
from rpojax.training import checkpoint as checkpoints
from rpojax.training.synthetic_data.ray_tracing import Views
from rpojax.training.synthetic_data.target_mesh import TargetMesh
from rpojax.vision.radiance_field.grid_field import GridField, with_occupancy
from rpojax.vision.radiance_field.initial_grid import initialize_grid
from rpojax.vision.radiance_field.nerf_field import initialize_nerf
from rpojax.vision.radiance_field.render_image import linear_to_srgb, pixel_directions
from rpojax.vision.radiance_field.target_field import RadianceField, render_rays

_STEPS_PER_CHUNK = 50
_LEARNING_RATES = {"raw_density": 0.03, "features": 0.02, "network": 3e-3, "trunk": 2e-3, "head": 2e-3}
_ADAM = optax.scale_by_adam(b2=0.99, eps=1e-10)
_VALIDATION_VIEWS = 12
_MARGIN_PX = 3
_NEIGHBOUR_PAIRS = 8192
_SMOOTHNESS = 1e-2


@dataclasses.dataclass(frozen=True)
class FieldTrainingOptions:
    """How a field is trained: most steps (in chunks of 50), rays a step, seed, kind of field, wall-clock limit [s], and
    how many checks, one every 250 steps, without a gain of `gain_db` end it."""

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
    """How far training is: step of so many, error on held-out views [dB], seconds so far."""

    done: int
    total: int
    psnr_db: float
    elapsed_s: float


OnFieldProgress = Callable[[FieldTrainingProgress], None]


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
    on_progress: OnFieldProgress = lambda step: None,
) -> tuple[RadianceField, list[FieldTrainingProgress]]:
    """A field trained on all but a few of the views, and its history; goes on from a checkpoint of the same one."""
    start_time = time.monotonic()
    field = initialize_field(mesh, options)
    held = min(_VALIDATION_VIEWS, len(views) // 8)
    data, check = _ray_data(views, 0, len(views) - held), _ray_data(views, len(views) - held, len(views))
    check = _subsample(check, 16_384)
    state = _ADAM.init(_trained_weights(field))
    nodes = jnp.asarray(
        np.argwhere(np.asarray(field.node_row) > 0) if isinstance(field, GridField) else [[0]], jnp.int32
    )
    done, best, since, history = 0, -np.inf, 0, []
    key = _training_digest(mesh, views, options)
    found = checkpoints.read_checkpoint(checkpoint, key, (_trained_weights(field), state)) if checkpoint else None
    if found:
        (weights, state), progress = found
        history, best, since = [FieldTrainingProgress(**progress["last"])], progress["best"], progress["since"]
        done = history[-1].done
        field = _with_current_occupancy(replace(field, **weights))
        start_time -= history[-1].elapsed_s
    while done + _STEPS_PER_CHUNK <= options.steps and since < options.patience:
        random = jax.random.fold_in(jax.random.key(options.seed), done)
        shares = (done + jnp.arange(_STEPS_PER_CHUNK, dtype=jnp.float32)) / options.steps
        field, state = _run_chunk(options.rays, field, state, data, nodes, random, shares)
        done += _STEPS_PER_CHUNK
        late = options.limit_s is not None and time.monotonic() - start_time > options.limit_s
        if done % (5 * _STEPS_PER_CHUNK) and done + _STEPS_PER_CHUNK <= options.steps and not late:
            continue
        field = _with_current_occupancy(field)
        error = float(_validation_error(field, check))
        # Steps are done when their result is there, not when they were asked for.
        elapsed = time.monotonic() - start_time
        history.append(FieldTrainingProgress(done, options.steps, float(-10.0 * np.log10(error)), elapsed))
        since = 0 if history[-1].psnr_db > best + options.gain_db else since + 1
        best = max(best, history[-1].psnr_db)
        if checkpoint:
            progress = {"last": dataclasses.asdict(history[-1]), "best": best, "since": since}
            checkpoints.write_checkpoint(checkpoint, key, (_trained_weights(field), state), progress)
        on_progress(history[-1])
        if late:
            break
    return field, history


def _trained_weights(field: RadianceField) -> dict[str, Any]:
    """What of a field is trained."""
    names = ("raw_density", "features", "network") if isinstance(field, GridField) else ("trunk", "head")
    return {name: getattr(field, name) for name in names}


def _with_current_occupancy(field: RadianceField) -> RadianceField:
    """The field with a lookup, if it has one, of its present matter."""
    return with_occupancy(field) if isinstance(field, GridField) else field


def _scale_by_learning_rates(change: Any, share: jax.Array) -> dict[str, Any]:
    """Changes at the rates of their kinds of weights, which fall along a cosine with the share of steps done."""
    fall = 0.515 + 0.485 * jnp.cos(jnp.pi * jnp.minimum(share, 1.0))
    rates = {name: -rate * fall for name, rate in _LEARNING_RATES.items()}
    return {name: jax.tree.map(partial(jnp.multiply, rates[name]), part) for name, part in change.items()}


RayData = tuple[jax.Array, jax.Array, jax.Array, jax.Array, jax.Array, jax.Array]


def _ray_data(views: Views, first: int, last: int) -> RayData:
    """Camera positions and Suns by view; for every ray near the target its view, direction in T, sRGB code, alpha."""
    import cv2

    size = views.alpha.shape[1]
    disc = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
    tangents = pixel_directions(size, views.field_of_view_deg)
    view, direction, color, alpha = [], [], [], []
    for index in range(first, last):
        near = cv2.dilate((views.alpha[index] > 0.0).astype(np.uint8), disc) > 0
        view.append(np.full(int(near.sum()), index - first, np.int32))
        direction.append((tangents[near] @ views.rotation[index]).astype(np.float32))
        color.append(views.rgb[index][near])
        alpha.append(views.alpha[index][near].astype(np.float32))
    position, sun = (jnp.asarray(values[first:last], jnp.float32) for values in (views.position, views.sun))
    merged = [jnp.asarray(np.concatenate(values)) for values in (view, direction, color, alpha)]
    return position, sun, merged[0], merged[1], linear_to_srgb(merged[2].astype(jnp.float32)), merged[3]


def _subsample(data: RayData, count: int) -> RayData:
    """About `count` of the rays, evenly taken."""
    position, sun, view, direction, color, alpha = data
    step = max(1, len(view) // count)
    return position, sun, view[::step], direction[::step], color[::step], alpha[::step]


def _mean_squared_errors(
    field: RadianceField, data: RayData, chosen: jax.Array, jitter: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Mean squared errors of colour codes and of alpha over some of the rays."""
    position, sun, view, direction, color, alpha = data
    where = view[chosen]
    rays = render_rays(field, position[where], direction[chosen], sun[where], jitter)
    return jnp.mean((linear_to_srgb(rays.color) - color[chosen]) ** 2), jnp.mean((rays.alpha - alpha[chosen]) ** 2)


@jax.jit
def _validation_error(field: RadianceField, data: RayData) -> jax.Array:
    part = min(1024, data[2].shape[0])
    count = data[2].shape[0] // part * part
    parts = jnp.arange(count, dtype=jnp.int32).reshape(-1, part)
    zero = jnp.zeros((part,), jnp.float32)
    return jnp.mean(jax.lax.map(lambda chosen: _mean_squared_errors(field, data, chosen, zero)[0], parts))


@partial(jax.jit, static_argnums=(0,))
def _run_chunk(
    rays: int, field: RadianceField, state: Any, data: RayData, nodes: jax.Array, key: jax.Array, progress: jax.Array
) -> tuple[RadianceField, Any]:
    """A chunk of steps, each at its share of the training; one program whatever the number of steps."""

    def loss(weights: dict[str, Any], chosen: jax.Array, jitter: jax.Array, near: jax.Array) -> jax.Array:
        color, alpha = _mean_squared_errors(replace(field, **weights), data, chosen, jitter)
        return color + 0.5 * alpha + _smoothness_penalty(weights, near)

    def step(carry: Any, now: tuple[jax.Array, jax.Array]) -> tuple[Any, None]:
        (weights, state), (key, share) = carry, now
        chosen = jax.random.randint(key, (rays,), 0, data[2].shape[0], jnp.int32)
        jitter = jax.random.uniform(jax.random.fold_in(key, 1), (rays,), jnp.float32, -0.5, 0.5)
        near = _random_neighbours(field, nodes, jax.random.fold_in(key, 2))
        gradient = jax.grad(loss)(weights, chosen, jitter, near)
        if "raw_density" in gradient:
            # Empty space stays empty, and normals are those of the mesh.
            gradient["raw_density"] = gradient["raw_density"].at[0].set(0.0)
            gradient["features"] = gradient["features"].at[:, :3].set(0.0)
        with jax.numpy_dtype_promotion("standard"):  # optax raises a number to the power of its count
            change, state = _ADAM.update(gradient, state)
        return (optax.apply_updates(weights, _scale_by_learning_rates(change, share)), state), None

    (weights, state), _ = jax.lax.scan(
        step, (_trained_weights(field), state), (jax.random.split(key, _STEPS_PER_CHUNK), progress)
    )
    return replace(field, **weights), state


def _random_neighbours(field: RadianceField, nodes: jax.Array, key: jax.Array) -> jax.Array:
    """Rows (n, 2) of random neighbouring nodes; row 0, empty space, is a neighbour of itself alone."""
    if not isinstance(field, GridField):
        return jnp.zeros((1, 2), jnp.int32)
    limits = jnp.array(field.node_row.shape, jnp.int32)[None, :]
    place = nodes[jax.random.randint(key, (_NEIGHBOUR_PAIRS,), 0, nodes.shape[0], jnp.int32)]
    step = jnp.eye(3, dtype=jnp.int32)[
        jax.random.randint(jax.random.fold_in(key, 1), (_NEIGHBOUR_PAIRS,), 0, 3, jnp.int32)
    ]
    other = jnp.minimum(place + step, limits - 1)
    rows = jnp.stack([field.node_row[p[:, 0], p[:, 1], p[:, 2]] for p in (place, other)], axis=1)
    return jnp.where(jnp.any(rows == 0, axis=1, keepdims=True), 0, rows)


def _smoothness_penalty(weights: dict[str, Any], near: jax.Array) -> jax.Array:
    """Mean squared difference of neighbouring features, weighed: materials are smooth."""
    if "features" not in weights:
        return jnp.zeros((), jnp.float32)
    pair = weights["features"][near]
    return _SMOOTHNESS * jnp.mean((pair[:, 0] - pair[:, 1])[:, 3:] ** 2)


def _training_digest(mesh: TargetMesh, views: Views, options: FieldTrainingOptions) -> str:
    digest = hashlib.sha256(repr((mesh.name, dataclasses.replace(options, limit_s=None), len(views))).encode())
    for values in (mesh.vertices, views.position, views.sun, views.rgb.sum(axis=(1, 2, 3))):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def model_card(
    mesh: TargetMesh, views: Views, options: FieldTrainingOptions, history: list[FieldTrainingProgress], command: str
) -> Mapping[str, object]:
    """What to say about a field: how it was made, and how well it did on views held out."""
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
