"""Random views of a target: camera poses all round it, and Suns up to a phase angle."""

import dataclasses

import numpy as np

from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh

PHASE_LIMIT_DEG = 110.0
FIELD_OF_VIEW_DEG = 26.0
FRAME_FILL = 0.82
"""Fraction of the frame's width that the bounding sphere of the target fills; its silhouette then fills about 60 %."""
EARTH_HALF_ANGLE_DEG = 68.0
"""Half angle of the Earth's disc from an orbit 500 km up."""


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
        fill_half_angle_deg: half angle of the cone from which fill light comes [deg]; 180 for light from all sides
        glint_fraction: fraction of views in which a face mirrors the Sun into the camera
        glint_spread_deg: largest angle between the Sun and its mirrored direction in these [deg]
        seed: seed of all random numbers
    """

    count: int
    size_px: int = 128
    samples: int = 64
    range_scale: tuple[float, float] = (1.0, 1.0)
    field_of_view_deg: float = FIELD_OF_VIEW_DEG
    range_m: float | None = None
    phase_limit_deg: float = PHASE_LIMIT_DEG
    fill_half_angle_deg: float = EARTH_HALF_ANGLE_DEG
    glint_fraction: float = 0.0
    glint_spread_deg: float = 3.0
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


@dataclasses.dataclass(frozen=True)
class ViewPoses:
    """Poses and lights of views in target axes T: camera axes (n, 3, 3), camera (n, 3) [m], Sun and fill light (n, 3).

    Directions are unit vectors to the light.
    """

    rotation: np.ndarray
    position: np.ndarray
    sun: np.ndarray
    fill: np.ndarray


def sample_views(mesh: TargetMesh, sampling: ViewSampling) -> ViewPoses:
    """Poses and lights of `sampling.count` views; view i depends on the seed and i alone."""
    center, radius = center_and_radius(mesh.bounds)
    nominal = sampling.range_m or nominal_range(radius, sampling.field_of_view_deg)
    mirrors = _mirrors(mesh) if sampling.glint_fraction > 0.0 else None
    views = [_sample_view(center, nominal, mirrors, sampling, index) for index in range(sampling.count)]
    return ViewPoses(*(np.stack(values) for values in zip(*views, strict=True)))


def _sample_view(
    center: np.ndarray,
    nominal_m: float,
    mirrors: tuple[np.ndarray, np.ndarray] | None,
    sampling: ViewSampling,
    index: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Camera axes, camera, and directions to the Sun and the fill light of one view."""
    rng = np.random.default_rng([sampling.seed, index])
    away, up = unit_vectors(rng, 2)
    distance = nominal_m * rng.uniform(*sampling.range_scale)
    z = -away
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    limit = np.cos(np.radians(sampling.phase_limit_deg))
    sun = unit_vectors(rng, 1)[0]
    while sun @ away < limit:
        sun = unit_vectors(rng, 1)[0]
    fill = unit_vectors(rng, 1)[0]
    if mirrors is not None and rng.random() < sampling.glint_fraction:
        sun = _glinting_sun(rng, mirrors, away, limit, sampling.glint_spread_deg, sun)
    return np.stack([x, np.cross(z, x), z]), center + distance * away, sun, fill


def _mirrors(mesh: TargetMesh) -> tuple[np.ndarray, np.ndarray]:
    """Normals (m, 3) of the faces and their shares (m,) in the brightness of glints.

    The peak of a microfacet lobe is as 1 / roughness^4 (Walter et al., 2007, with the square of roughness as width).
    """
    normals, weights = [], []
    for part in mesh.parts:
        a, b, c = (part.vertices[part.faces[:, corner]] for corner in range(3))
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1)
        normals.append(normal / np.maximum(length, 1e-300)[:, None])
        weights.append(length / max(part.material.roughness, 0.05) ** 4)
    weight = np.concatenate(weights)
    return np.concatenate(normals), weight / weight.sum()


def _glinting_sun(
    rng: np.random.Generator,
    mirrors: tuple[np.ndarray, np.ndarray],
    away: np.ndarray,
    limit: float,
    spread_deg: float,
    otherwise: np.ndarray,
) -> np.ndarray:
    """A Sun near the direction that a random face mirrors to a camera at `away`; `otherwise` if there is none."""
    normals, weights = mirrors
    for _ in range(100):
        normal = normals[rng.choice(len(weights), p=weights)]
        normal = normal if normal @ away > 0.0 else -normal
        mirrored = 2.0 * (normal @ away) * normal - away
        angle = np.radians(spread_deg) * np.sqrt(rng.random())
        across = np.cross(mirrored, unit_vectors(rng, 1)[0])
        sun = np.cos(angle) * mirrored + np.sin(angle) * across / np.linalg.norm(across)
        if sun @ away >= limit:
            return sun
    return otherwise
