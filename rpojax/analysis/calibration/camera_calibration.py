"""Fits the statistical camera to the rendered one: views are drawn, rendered, looked at, and their outcomes fitted.

Views come from all round the target and at every attitude, under every Sun that the camera may see it in, before space
and before the Earth, in the middle of the frame and cut by its edges. The likelihood of what the detector made of them
is maximised by gradient over the small network of `sensors.statistical_camera`.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from rpojax.core import quaternion
from rpojax.core.constants import RADIUS_EARTH
from rpojax.scenario import params, trained_files
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors import rendered_camera, statistical_camera, statistical_camera_file
from rpojax.sensors.rendered_camera import Imaging, Networks
from rpojax.sensors.statistical_camera import WIDE_SIGMA_FACTOR, CameraStatistics
from rpojax.vision import bounding_box, pinhole
from rpojax.vision.detector.two_stage_detector import detect
from rpojax.vision.imaging.image_formation import Scene
from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.radiance_field.volume_rendering import initialize_layers

_BATCH = 16
_STEPS = 4000
_CHECK_EVERY = 100
_ROWS = 1024
_RATE = 4e-3
_DECAY = 1.0
"""Of the weights of layers; what they are added to is free."""
_HELD_OUT = 0.15
_CENTERED = 0.7
_POINTING_DEG = 0.5
_PENUMBRA = 0.1
"""Share of views under a Sun that the Earth hides in part."""
RANGE_FACTORS = (0.6, 1.5)
"""Views go from so much of the nearest of start and station to so much of the farthest."""
_OVERLAP = 0.1
_FALSE_SIDE = (float(np.log(12.0)), 0.6)
_FALSE_SCORE = (0.5, 0.7)

OnProgress = Callable[[int, int], None]


@dataclasses.dataclass(frozen=True)
class Views:
    """Drawn geometry: camera from target in N [m], attitudes, Sun and how much of it, place [Earth radii], turn of the
    Earth [rad]."""

    r_ST_N: np.ndarray
    q_TN: np.ndarray
    q_KN: np.ndarray
    sun_N: np.ndarray
    sunlight: np.ndarray
    place_N: np.ndarray
    earth_turn: np.ndarray


@dataclasses.dataclass(frozen=True)
class DetectionOutcomes:
    """What the detector made of views: features (n, f), outlines and boxes (n, 4) [px], scores, in the frame or not."""

    features: np.ndarray
    outline: np.ndarray
    in_frame: np.ndarray
    edges: np.ndarray
    score: np.ndarray

    @property
    def overlap(self) -> np.ndarray:
        """Intersection over union of box and outline."""
        return np.asarray(
            jax.vmap(bounding_box.intersection_over_union)(jnp.asarray(self.edges), jnp.asarray(self.outline))
        )


def sample_views(file: ScenarioFile, count: int, seed: int) -> Views:
    """Random views that a run of a scenario might have, and more."""
    rng = np.random.default_rng(seed)
    near, far = trained_files.range_limits(file.model_dump())
    distance = np.exp(rng.uniform(np.log(RANGE_FACTORS[0] * near), np.log(RANGE_FACTORS[1] * far), count))
    away = random_directions(rng, count)
    place = random_directions(rng, count) * file.orbit.semi_major_axis_m / RADIUS_EARTH
    sun = _suns(rng, file, away, place)
    offset = np.radians(_POINTING_DEG) * rng.normal(size=(count, 2))
    spread = 0.6 * np.radians(file.camera.field_of_view_deg) * rng.uniform(-1.0, 1.0, (count, 2))
    offset = np.where(rng.random((count, 1)) < _CENTERED, offset, spread)
    return Views(
        r_ST_N=distance[:, None] * away,
        q_TN=_unit(rng.normal(size=(count, 4))),
        q_KN=np.stack(
            [_looking(-a, o, r) for a, o, r in zip(away, offset, rng.uniform(0, 2 * np.pi, count), strict=True)]
        ),
        sun_N=sun,
        sunlight=np.where(rng.random(count) < _PENUMBRA, rng.uniform(0.5, 1.0, count), 1.0),
        place_N=place,
        earth_turn=rng.uniform(0.0, 2.0 * np.pi, count),
    )


def view_limits(file: ScenarioFile) -> dict[str, tuple[float, float]]:
    """Smallest and largest values of what the views are drawn over, by the keys of `networks.limits`."""
    found = trained_files.view_limits(file.model_dump())
    near, far = found[trained_files.RANGE_KEY]
    return {**found, trained_files.RANGE_KEY: (RANGE_FACTORS[0] * near, RANGE_FACTORS[1] * far)}


def _unit(values: np.ndarray) -> np.ndarray:
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def random_directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors (count, 3), uniform on the sphere."""
    return _unit(rng.normal(size=(count, 3)))


def _suns(rng: np.random.Generator, file: ScenarioFile, away: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Suns under which the camera may see the target: not in the Earth's shadow, phase angle and exclusion kept."""
    sun = np.zeros_like(away)
    missing = np.ones(len(away), bool)
    lowest = max(np.cos(np.radians(file.camera.phase_limit_deg)), -np.cos(np.radians(file.camera.sun_exclusion_deg)))
    while missing.any():
        sun[missing] = random_directions(rng, int(missing.sum()))
        height = np.sum(sun * place, axis=1)
        shadowed = (height < 0.0) & (np.sum(place**2, axis=1) - height**2 < 1.0)
        missing = shadowed | (np.sum(sun * away, axis=1) < lowest)
    return sun


def _looking(line: np.ndarray, offset: np.ndarray, roll: float) -> np.ndarray:
    """`q_KN` of a camera that sees a direction at small angles from its boresight, turned about it."""
    helper = np.eye(3)[np.argmin(np.abs(line))]
    x = _unit(np.cross(line, helper))
    rows = np.stack([x, np.cross(line, x), line])
    turn = np.array([[np.cos(roll), np.sin(roll), 0.0], [-np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    q = quaternion.from_matrix(jnp.asarray(turn @ rows))
    return np.asarray(quaternion.multiply(quaternion.exp(jnp.asarray([*offset, 0.0])), q))


def detect_in_views(
    file: ScenarioFile, views: Views, seed: int, on_progress: OnProgress = lambda done, total: None
) -> DetectionOutcomes:
    """Renders views and detects boxes in them, as the rendered camera of a run does."""
    tables = file.model_dump()
    # What is being fitted is not needed yet.
    tables["camera"]["model"] = "geometric"
    numbers = params.build_params(tables, file.camera.width_px, file.camera.height_px)
    trained, rays = trained_files.load_networks(tables), trained_files.picture_sampling(tables)
    size = (file.camera.width_px, file.camera.height_px)
    lens = pinhole.pinhole_intrinsics(numbers.camera.field_of_view, *size)
    one = jax.jit(jax.vmap(partial(_look, numbers, rays, size, lens), in_axes=(None, None, 0, 0)))
    count = len(views.r_ST_N)
    keys = jax.random.key_data(jax.random.split(jax.random.key(seed, impl="threefry2x32"), count))
    parts = []
    for first in range(0, count, _BATCH):
        # The last batch is filled up with views of the first, so that there is one program.
        rows = (first + np.arange(_BATCH)) % count
        chosen = Views(**{f.name: getattr(views, f.name)[rows] for f in dataclasses.fields(Views)})
        found = one(numbers.imaging, trained, jax.tree.map(jnp.asarray, dataclasses.asdict(chosen)), keys[rows])
        parts.append([np.asarray(value)[: count - first] for value in found])
        on_progress(min(first + _BATCH, count), count)
    return DetectionOutcomes(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _look(
    numbers: Params,
    rays: RaySampling,
    size: tuple[int, int],
    lens: Intrinsics,
    imaging: Imaging,
    trained: Networks,
    view: dict[str, Array],
    key: Array,
) -> tuple[Array, ...]:
    scene = rendered_camera.to_float32(_scene(view))
    hull_T = numbers.plant.target.hull
    R_KT, r_TK_K = scene.R_KT.astype(jnp.float64), quaternion.rotate(view["q_KN"], -view["r_ST_N"])
    hull_K = jnp.sum(R_KT[None, :, :] * hull_T[:, None, :], axis=2) + r_TK_K[None, :]
    outline = bounding_box.projected_box(lens, hull_K).astype(jnp.float32)
    middle, extent = bounding_box.box_center(outline), bounding_box.box_size(outline)
    window = rendered_camera.choose_window(lens, *size, middle, extent, jnp.ones((), bool))
    picture = rendered_camera.render_window(imaging, trained, rays, window, *size, scene, key)
    found = detect(trained.detector, picture[None], rendered_camera.REFINED_PROPOSALS)
    corner = jnp.concatenate([window.corner_px, window.corner_px])
    edges = jnp.clip(corner + found.box_px[0, 0] * window.binning, 0.0, jnp.array([*size, *size], jnp.float32))
    visible, _ = statistical_camera.visible_outline(outline, size)
    in_frame = statistical_camera.is_in_frame(outline, size)
    return statistical_camera.features(scene, outline, size), visible, in_frame, edges, found.score[0, 0]


def _scene(view: dict[str, Array]) -> Scene:
    q_KT = quaternion.multiply(view["q_KN"], quaternion.conjugate(view["q_TN"]))
    return Scene(
        r_KT_T=quaternion.rotate(view["q_TN"], view["r_ST_N"]),
        R_KT=quaternion.to_matrix(q_KT),
        sun_T=quaternion.rotate(view["q_TN"], view["sun_N"]),
        sunlight=view["sunlight"],
        R_KN=quaternion.to_matrix(view["q_KN"]),
        position_N=view["place_N"],
        sun_N=view["sun_N"],
        earth_rotation=view["earth_turn"],
    )


@dataclasses.dataclass(frozen=True)
class CameraFit:
    """A fitted camera, and its mean log-likelihood on outcomes that it was fitted to and on others."""

    statistics: CameraStatistics
    log_likelihood: float
    log_likelihood_held_out: float


def fit_camera(outcomes: DetectionOutcomes, threshold: float, seed: int = 0) -> CameraFit:
    """The camera of the greatest likelihood; boxes below the score `threshold` count as none."""
    rows = _rows(outcomes, threshold)
    held = max(1, round(_HELD_OUT * len(outcomes.score)))
    train, check = ({name: value[part] for name, value in rows.items()} for part in (slice(held, None), slice(held)))
    free = {
        "layers": initialize_layers(jax.random.key(seed), statistical_camera_file.LAYER_WIDTHS),
        "wide": jnp.full((), -2.0, jnp.float32),
    }
    mean, spread = train["features"].mean(axis=0), train["features"].std(axis=0)
    # What does not change in the views tells nothing, and must not tell much where it does change.
    spread = jnp.where(spread < 1e-3, jnp.float32(1.0), spread)
    sides = outcomes.edges[:, 2:] - outcomes.edges[:, :2]
    wrong = np.asarray(rows["kind"]) == 2
    false_side = _normal(np.log(np.maximum(sides[wrong], 1.0)), _FALSE_SIDE)
    false_score = _normal(np.asarray(rows["logit"])[wrong], _FALSE_SCORE)

    def assemble(free: dict[str, Any]) -> CameraStatistics:
        return CameraStatistics(
            mean=mean,
            spread=spread,
            layers=free["layers"],
            wide_share=jax.nn.sigmoid(free["wide"]),
            mixing=jnp.eye(4, dtype=jnp.float32),
            lasting_share=jnp.zeros((), jnp.float32),
            lasting_angle=jnp.ones((), jnp.float32),
            false_log_side=false_side,
            false_score=false_score,
        )

    free = _maximise(assemble, free, train, check, seed)
    statistics = assemble(free)
    return CameraFit(statistics, float(_mean(statistics, train)), float(_mean(statistics, check)))


def _normal(values: np.ndarray, otherwise: tuple[float, float]) -> Array:
    """Mean and 1 sigma of some values; another guess where they are too few."""
    return jnp.asarray((values.mean(), max(values.std(), 0.1)) if len(values) >= 8 else otherwise, jnp.float32)


def normalised_errors(statistics: CameraStatistics, outcomes: DetectionOutcomes, threshold: float) -> np.ndarray:
    """Errors (n, 4) of the edges less their bias, in their 1 sigma; NaN where there is no box of the target."""
    rows = _rows(outcomes, threshold)

    def one(row: dict[str, Array]) -> Array:
        found = statistical_camera.frame_distribution(statistics, row["features"], row["in_frame"])
        z = (row["error"] - found.bias) * jnp.exp(-found.log_sigma)
        return jnp.where(row["kind"] == 1, z, jnp.nan)

    return np.asarray(jax.jit(jax.vmap(one))(rows), np.float64)


def _rows(outcomes: DetectionOutcomes, threshold: float) -> dict[str, Array]:
    """What the likelihood needs: kind is 0 for no box, 1 for one of the target, 2 for a false one."""
    seen = outcomes.score >= threshold
    true = seen & outcomes.in_frame & (outcomes.overlap > _OVERLAP)
    size = np.maximum(np.sqrt(np.prod(np.maximum(outcomes.outline[:, 2:] - outcomes.outline[:, :2], 0.1), axis=1)), 2.0)
    score = np.clip(outcomes.score, 1e-4, 1.0 - 1e-4)
    return {
        "features": jnp.asarray(outcomes.features, jnp.float32),
        "in_frame": jnp.asarray(outcomes.in_frame),
        "kind": jnp.asarray(np.where(true, 1, np.where(seen, 2, 0)).astype(np.int32)),
        "error": jnp.asarray((outcomes.edges - outcomes.outline) / size[:, None], jnp.float32),
        "logit": jnp.asarray(np.log(score / (1.0 - score)), jnp.float32),
    }


def _log_likelihood(statistics: CameraStatistics, row: dict[str, Array]) -> Array:
    found = statistical_camera.frame_distribution(statistics, row["features"], row["in_frame"])
    kind = jnp.stack([found.log_none, found.log_true, found.log_false])[row["kind"]]
    z = (row["error"] - found.bias) * jnp.exp(-found.log_sigma)
    narrow = -0.5 * jnp.sum(z * z) - jnp.sum(found.log_sigma)
    wide = (
        -0.5 * jnp.sum(z * z) / WIDE_SIGMA_FACTOR**2
        - jnp.sum(found.log_sigma)
        - 4.0 * jnp.log(jnp.float32(WIDE_SIGMA_FACTOR))
    )
    share = statistics.wide_share
    edges = jnp.logaddexp(jnp.log1p(-share) + narrow, jnp.log(share) + wide)
    s = (row["logit"] - found.score[0]) * jnp.exp(-found.score[1])
    score = -0.5 * s * s - found.score[1]
    return kind + jnp.where(row["kind"] == 1, edges + score, 0.0)


@jax.jit
def _mean(statistics: CameraStatistics, rows: dict[str, Array]) -> Array:
    return jnp.mean(jax.vmap(partial(_log_likelihood, statistics))(rows))


def _maximise(
    assemble: Callable[[dict[str, Any]], CameraStatistics],
    free: dict[str, Any],
    rows: dict[str, Array],
    check: dict[str, Array],
    seed: int,
) -> dict[str, Any]:
    """What is free, where the likelihood of the outcomes held out is greatest on the way up that of the others."""
    decayed = {"layers": tuple((True, False) for _ in free["layers"]), "wide": False}
    optimiser = optax.adamw(optax.cosine_decay_schedule(_RATE, _STEPS), weight_decay=_DECAY, mask=decayed)
    count = rows["kind"].shape[0]

    def step(carry: Any, key: Array) -> tuple[Any, None]:
        free, state = carry
        chosen = jax.random.randint(key, (min(_ROWS, count),), 0, count, jnp.int32)
        some = {name: value[chosen] for name, value in rows.items()}
        slope = jax.grad(lambda free: -_mean(assemble(free), some))(free)
        with jax.numpy_dtype_promotion("standard"):  # optax raises a number to the power of its count
            change, state = optimiser.update(slope, state, free)
        return (optax.apply_updates(free, change), state), None

    advance = jax.jit(lambda carry, keys: jax.lax.scan(step, carry, keys)[0])
    carry, best, found = (free, optimiser.init(free)), -np.inf, free
    for keys in jnp.split(jax.random.split(jax.random.key(seed), _STEPS), _STEPS // _CHECK_EVERY):
        carry = advance(carry, keys)
        likelihood = float(_mean(assemble(carry[0]), check))
        if likelihood > best:
            best, found = likelihood, carry[0]
    return found


def outcome_summary(outcomes: DetectionOutcomes, threshold: float) -> dict[str, float]:
    """Figures of the outcomes: share with a box, false ones, median overlap, bias and spread of the edges [px]."""
    rows = _rows(outcomes, threshold)
    kind = np.asarray(rows["kind"])
    error = (outcomes.edges - outcomes.outline)[kind == 1]
    inside = outcomes.in_frame
    return {
        "detected_in_frame": float(np.mean(kind[inside] == 1)),
        "false_boxes": float(np.mean(kind == 2)),
        "median_overlap": float(np.median(outcomes.overlap[kind == 1])) if (kind == 1).any() else 0.0,
        "edge_bias_px": float(np.abs(error.mean(axis=0)).max()) if len(error) else 0.0,
        "edge_sigma_px": float(error.std(axis=0).mean()) if len(error) else 0.0,
    }
