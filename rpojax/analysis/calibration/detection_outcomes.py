"""Detections in rendered views: outlines, boxes and scores for the calibration of a statistical camera.

Random views of the target for the calibration of a camera: geometry, Sun, and the Earth behind.

Views come from all directions and at every attitude, under every Sun under which the camera may see the target, before
space and before the Earth, in the middle of the frame and cut by its edges.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core import quaternion
from rpojax.core.constants import RADIUS_EARTH
from rpojax.core.pytree import concatenate, pytree
from rpojax.flight.guidance import detector_window
from rpojax.flight.guidance.detector_window import CameraFormat
from rpojax.scenario import params
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained import fitted_camera, image_sampling, trained_files
from rpojax.sensors import detector_input, rendered_camera, view_features
from rpojax.sensors.imaging import Imaging
from rpojax.sensors.rendered_camera import Networks
from rpojax.vision import bounding_box, box_projection, pinhole
from rpojax.vision.detector.two_stage_detector import detect
from rpojax.vision.imaging.image_formation import Scene
from rpojax.vision.intersection_over_union import intersection_over_union
from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.ray_budget import RaySampling

_CENTERED_FRACTION = 0.7
_POINTING_DEG = 0.5
_PENUMBRA_FRACTION = 0.1
"""Fraction of views with a Sun that the Earth hides in part."""
RANGE_FACTORS = (0.6, 1.5)
"""Range of the views over the nearest and the farthest of start and station."""
_BATCH_SIZE = 16
_MIN_OVERLAP = 0.1
"""Intersection over union of box and outline below which the box is a false one."""
OnProgress = Callable[[int, int], None]
"""Called with the number of rendered views, and of all views."""


@dataclass(frozen=True)
class Views:
    """Geometry of views.

    Attributes:
        r_ST_N: (n, 3) camera from target [m]
        q_TN: (n, 4) attitude of the target
        q_KN: (n, 4) attitude of the camera
        sun_N: (n, 3) direction of the Sun
        sunlight: (n,) visible fraction of the Sun
        place_N: (n, 3) position [Earth radii]
        earth_turn: (n,) rotation of the Earth [rad]
    """

    r_ST_N: np.ndarray
    q_TN: np.ndarray
    q_KN: np.ndarray
    sun_N: np.ndarray
    sunlight: np.ndarray
    place_N: np.ndarray
    earth_turn: np.ndarray


def sample_views(file: ScenarioFile, count: int, seed: int, range_m: tuple[float, float] | None = None) -> Views:
    """Random views in a range [m], by default a somewhat wider one than that of start and station of a scenario."""
    rng = np.random.default_rng(seed)
    near, far = range_m or _wider_range(file)
    distance = np.exp(rng.uniform(np.log(near), np.log(far), count))
    away = random_directions(rng, count)
    place = random_directions(rng, count) * file.orbit.semi_major_axis_m / RADIUS_EARTH
    sun = _sun_directions(rng, file, away, place)
    offset = np.radians(_POINTING_DEG) * rng.normal(size=(count, 2))
    across_frame = 0.6 * np.radians(file.camera.field_of_view_deg) * rng.uniform(-1.0, 1.0, (count, 2))
    offset = np.where(rng.random((count, 1)) < _CENTERED_FRACTION, offset, across_frame)
    return Views(
        r_ST_N=distance[:, None] * away,
        q_TN=_unit(rng.normal(size=(count, 4))),
        q_KN=np.stack(
            [_camera_attitude(-a, o, r) for a, o, r in zip(away, offset, rng.uniform(0, 2 * np.pi, count), strict=True)]
        ),
        sun_N=sun,
        sunlight=np.where(rng.random(count) < _PENUMBRA_FRACTION, rng.uniform(0.5, 1.0, count), 1.0),
        place_N=place,
        earth_turn=rng.uniform(0.0, 2.0 * np.pi, count),
    )


def view_limits(file: ScenarioFile, range_m: tuple[float, float] | None = None) -> dict[str, tuple[float, float]]:
    """Smallest and largest values of the sampled quantities, by the keys of `fitted_camera.view_limits`."""
    return {**fitted_camera.view_limits(file.model_dump()), fitted_camera.RANGE_KEY: range_m or _wider_range(file)}


def _wider_range(file: ScenarioFile) -> tuple[float, float]:
    near, far = fitted_camera.ranges_in_use(file.model_dump())
    return RANGE_FACTORS[0] * near, RANGE_FACTORS[1] * far


def _unit(values: np.ndarray) -> np.ndarray:
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def random_directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors (count, 3), uniform on the sphere."""
    return _unit(rng.normal(size=(count, 3)))


def _sun_directions(rng: np.random.Generator, file: ScenarioFile, away: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Directions (count, 3) of the Sun without eclipse, within the limits of phase angle and Sun exclusion."""
    sun = np.zeros_like(away)
    missing = np.ones(len(away), bool)
    lowest = max(np.cos(np.radians(file.camera.phase_limit_deg)), -np.cos(np.radians(file.camera.sun_exclusion_deg)))
    while missing.any():
        sun[missing] = random_directions(rng, int(missing.sum()))
        height = np.sum(sun * place, axis=1)
        shadowed = (height < 0.0) & (np.sum(place**2, axis=1) - height**2 < 1.0)
        missing = shadowed | (np.sum(sun * away, axis=1) < lowest)
    return sun


def _camera_attitude(line: np.ndarray, offset: np.ndarray, roll: float) -> np.ndarray:
    """`q_KN` of a camera that sees the direction `line` at small angles from its boresight, rolled about it."""
    helper = np.eye(3)[np.argmin(np.abs(line))]
    x = _unit(np.cross(line, helper))
    rows = np.stack([x, np.cross(line, x), line])
    turn = np.array([[np.cos(roll), np.sin(roll), 0.0], [-np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    q = quaternion.from_matrix(jnp.asarray(turn @ rows))
    return np.asarray(quaternion.multiply(quaternion.exp(jnp.asarray([*offset, 0.0])), q))


@pytree
class LandmarkOutcomes:
    """What the landmark network tells of views, in the boxes that the detector found.

    Attributes:
        places: (n, k, 2) right and down [px]
        sigma: (n, k) of a place [px]
        probability: (n, k) that a landmark is in sight
        true_places: (n, k, 2) [px]
        R_KT: (n, 3, 3) true attitude of the target in camera axes
    """

    places: Array
    sigma: Array
    probability: Array
    true_places: Array
    R_KT: Array


@pytree
class DetectionOutcomes:
    """Detections in views.

    Attributes:
        features: (n, f) of the view
        outline: (n, 4) edges of the target's visible outline [px]
        in_frame: (n,) bool, the target is in the frame
        edges: (n, 4) of the detected box [px]
        score: (n,) of the box
        landmarks: of the target, None of a camera that finds none
    """

    features: Array
    outline: Array
    in_frame: Array
    edges: Array
    score: Array
    landmarks: LandmarkOutcomes | None = None

    @property
    def overlap(self) -> np.ndarray:
        """Intersection over union (n,) of box and outline."""
        return np.asarray(intersection_over_union(self.edges, self.outline))

    @property
    def size(self) -> np.ndarray:
        """Geometric mean (n,) of the sides of the visible outline [px], at least that which scales errors."""
        sides = np.asarray(self.outline)[:, 2:] - np.asarray(self.outline)[:, :2]
        return np.maximum(np.sqrt(np.prod(np.maximum(sides, 0.1), axis=1)), view_features.MIN_OUTLINE_PX)

    def is_target(self, threshold: float) -> np.ndarray:
        """Whether there is a box of the target (n,); those with a score below the threshold count as none."""
        return np.asarray((self.score >= threshold) & self.in_frame & (self.overlap > _MIN_OVERLAP))


def detect_in_views(
    file: ScenarioFile, views: Views, seed: int, on_progress: OnProgress = lambda done, total: None
) -> DetectionOutcomes:
    """Renders views and detects boxes in them, as the rendered camera of a run does."""
    tables = file.model_dump()
    # The statistical camera to be fitted is not needed.
    tables["camera"]["model"] = "geometric"
    nominal = params.build_params(tables, file.camera.width_px, file.camera.height_px)
    networks, rays = trained_files.load_networks(tables, nominal.landmarks), image_sampling.image_sampling(tables)
    size = (file.camera.width_px, file.camera.height_px)
    lens = nominal.camera.lens(*size)
    detect_batch = jax.jit(jax.vmap(partial(_detect_in_view, nominal, rays, size, lens), in_axes=(None, None, 0, 0)))
    count = len(views.r_ST_N)
    keys = jax.random.key_data(jax.random.split(jax.random.key(seed, impl="threefry2x32"), count))
    parts = []
    for first in range(0, count, _BATCH_SIZE):
        # The last batch is padded with views of the first, so that there is one program.
        rows = (first + np.arange(_BATCH_SIZE)) % count
        chosen = Views(**{f.name: getattr(views, f.name)[rows] for f in dataclasses.fields(Views)})
        found = detect_batch(
            nominal.imaging, networks, jax.tree.map(jnp.asarray, dataclasses.asdict(chosen)), keys[rows]
        )
        parts.append(jax.tree.map(lambda value, kept=count - first: np.asarray(value)[:kept], found))
        on_progress(min(first + _BATCH_SIZE, count), count)
    return concatenate(parts)


def _detect_in_view(
    nominal: Params,
    rays: RaySampling,
    size: tuple[int, int],
    lens: Intrinsics,
    imaging: Imaging,
    networks: Networks,
    view: dict[str, Array],
    key: Array,
) -> DetectionOutcomes:
    scene = rendered_camera.to_float32(_scene(view))
    hull_T = nominal.plant.target.hull
    R_KT, r_TK_K = scene.R_KT.astype(jnp.float64), quaternion.rotate(view["q_KN"], -view["r_ST_N"])
    hull_K = jnp.sum(R_KT[None, :, :] * hull_T[:, None, :], axis=2) + r_TK_K[None, :]
    outline = box_projection.projected_box(lens, hull_K).astype(jnp.float32)
    middle, extent = bounding_box.box_center(outline), bounding_box.box_size(outline)
    camera = CameraFormat(*size, input_px=detector_input.input_side(*size))
    command = detector_window.window_around(camera, middle, extent, jnp.ones((), bool))
    window = detector_input.window_at(lens, command.corner_px, command.binning)
    picture = rendered_camera.render_window(imaging, networks, rays, window, *size, scene, key)
    found = detect(networks.detector, picture[None], rendered_camera.REFINED_PROPOSALS)
    corner = jnp.concatenate([window.corner_px, window.corner_px])
    edges = jnp.clip(corner + found.box_px[0, 0] * window.binning, 0.0, jnp.array([*size, *size], jnp.float32))
    visible, _ = view_features.visible_outline(outline, size)
    in_frame = view_features.is_in_frame(outline, size)
    landmarks = None
    if nominal.landmarks is not None:
        shown = rendered_camera.landmarks_in_picture(networks, window, picture, edges, size)
        places_K = jnp.sum(R_KT[None] * nominal.landmarks.positions[:, None, :], axis=2) + r_TK_K[None, :]
        landmarks = LandmarkOutcomes(
            places=shown.places,
            sigma=shown.sigma,
            probability=shown.visible_probability,
            true_places=pinhole.project(lens, places_K).T,
            R_KT=scene.R_KT,
        )
    return DetectionOutcomes(
        features=view_features.features(scene, outline, size),
        outline=visible,
        in_frame=in_frame,
        edges=edges,
        score=found.score[0, 0],
        landmarks=landmarks,
    )


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
