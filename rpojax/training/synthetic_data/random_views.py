"""Random views of a target: camera poses all round it, and Suns up to a phase angle."""

import dataclasses

import numpy as np

from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh

PHASE_LIMIT_DEG = 110.0
FIELD_OF_VIEW_DEG = 26.0
FRAME_FILL = 0.82
"""Fraction of the frame's width that the bounding sphere of the target fills; its silhouette then fills about 60 %."""


@dataclasses.dataclass(frozen=True)
class ViewSampling:
    """Distribution of random views, and settings of their ray tracing.

    Attributes:
        count: number of views
        size_px: side of the square frame [px]
        samples: samples per pixel
        range_scale: limits of the range by the nominal one
        field_of_view_deg: of the frame [deg]
        range_m: nominal range [m]; by default the target fills `FRAME_FILL` of the frame
        phase_limit_deg: largest phase angle [deg]
        earth_shine: irradiance of uniform light from all sides, by that of the Sun
        seed: seed of all random numbers
    """

    count: int
    size_px: int = 128
    samples: int = 64
    range_scale: tuple[float, float] = (1.0, 1.0)
    field_of_view_deg: float = FIELD_OF_VIEW_DEG
    range_m: float | None = None
    phase_limit_deg: float = PHASE_LIMIT_DEG
    earth_shine: float = 0.05
    seed: int = 0


def center_and_radius(bounds: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre [m] and radius [m] of the sphere around a box (2, 3)."""
    return 0.5 * (bounds[0] + bounds[1]), 0.5 * float(np.linalg.norm(bounds[1] - bounds[0]))


def nominal_range(radius_m: float, field_of_view_deg: float = FIELD_OF_VIEW_DEG) -> float:
    """Distance [m] at which a sphere fills the fraction `FRAME_FILL` of the frame's width."""
    return radius_m / (FRAME_FILL * np.tan(np.radians(0.5 * field_of_view_deg)))


def unit_vectors(rng: np.random.Generator, count: int) -> np.ndarray:
    """Random directions (n, 3), uniform on the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def sample_views(mesh: TargetMesh, sampling: ViewSampling) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations, positions and Suns of `sampling.count` views; view i depends on the seed and i alone."""
    center, radius = center_and_radius(mesh.bounds)
    nominal = sampling.range_m or nominal_range(radius, sampling.field_of_view_deg)
    rotations, positions, suns = [], [], []
    for index in range(sampling.count):
        rng = np.random.default_rng([sampling.seed, index])
        away, up = unit_vectors(rng, 2)
        distance = nominal * rng.uniform(*sampling.range_scale)
        z = -away
        x = np.cross(up, z)
        x /= np.linalg.norm(x)
        sun = unit_vectors(rng, 1)[0]
        while np.degrees(np.arccos(np.clip(sun @ away, -1.0, 1.0))) > sampling.phase_limit_deg:
            sun = unit_vectors(rng, 1)[0]
        rotations.append(np.stack([x, np.cross(z, x), z]))
        positions.append(center + distance * away)
        suns.append(sun)
    return np.stack(rotations), np.stack(positions), np.stack(suns)
