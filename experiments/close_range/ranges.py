"""Ranges against an independent ray caster, ranges of the simplified mesh, and time of 64 beams in a batch."""

import argparse
import time

import jax
import numpy as np
import trimesh

from rpojax.batching.vmap_last_axis import vmap
from rpojax.runtime.compiler_options import LOOP_OPTIONS
from rpojax.sensors.additional.surface_ranging import MOST_TRIANGLES
from rpojax.training.synthetic_data.meshes.packaged_target import packaged_target
from rpojax.vision.surface.ray_triangle_intersection import nearest_hits
from rpojax.vision.surface.surface_simplification import simplify

TOLERANCE_M = 1e-6
RAYS_A_POINT = 50


def rays(points: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) at 5 to 50 m, and unit vectors (n, rays, 3) to places in a box around the target."""
    rng = np.random.default_rng(seed)
    lines = rng.normal(size=(points, 3))
    origins = lines / np.linalg.norm(lines, axis=1)[:, None] * rng.uniform(5.0, 50.0, size=(points, 1))
    places = rng.uniform([-0.3, -0.85, -0.35], [0.3, 0.85, 0.35], size=(points, RAYS_A_POINT, 3))
    directions = places - origins[:, None]
    return origins, directions / np.linalg.norm(directions, axis=2)[:, :, None]


def by_trimesh(triangles: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[float, bool]:
    """Distance of the nearest hit, and whether the ray passes an edge before it closer than the tolerance."""
    normals, valid = trimesh.triangles.normals(triangles)
    kept = triangles[valid]
    lines = np.repeat(origin[None], len(kept), 0), np.repeat(direction[None], len(kept), 0)
    points, crosses, distances = trimesh.intersections.planes_lines(kept[:, 0], normals, *lines, True)
    corners = kept[crosses]
    weights = trimesh.triangles.points_to_barycentric(corners, points)
    sides = np.linalg.norm(corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]], axis=2)
    doubled = np.linalg.norm(trimesh.triangles.cross(corners), axis=1)
    inside = np.where((distances > 0.0) & np.all(weights >= 0.0, axis=1), distances, np.inf)
    from_edges = np.abs(np.min(weights * (doubled[:, None] / sides), axis=1))
    is_close = (from_edges < TOLERANCE_M) & (distances < inside.min() + TOLERANCE_M)
    return float(inside.min()), bool(is_close.any())


def time_of_beams(triangles: np.ndarray, runs: int = 128, beams: int = 64) -> float:
    """Least time of 64 beams of one run, of a batch on one core [s]."""
    rng = np.random.default_rng(0)
    origins = rng.normal(size=(3, runs))
    origins *= 30.0 / np.linalg.norm(origins, axis=0)
    directions = rng.uniform(-0.9, 0.9, size=(beams, 3, runs)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lowered = jax.jit(vmap(nearest_hits, (None, -1, -1), -1)).lower(triangles, origins, directions)
    compiled = lowered.compile(compiler_options=dict(LOOP_OPTIONS))
    times = []
    for _ in range(10):
        start = time.perf_counter()
        jax.block_until_ready(compiled(triangles, origins, directions))
        times.append(time.perf_counter() - start)
    return min(times) / runs


def main() -> int:
    """Prints the figures; the exit status is 1 where a range differs by more than the tolerance."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    triangles = np.concatenate([part.vertices[part.faces] for part in packaged_target().parts])
    origins, directions = rays(-(-asked.rays // RAYS_A_POINT), asked.seed)
    cast = jax.jit(nearest_hits)
    found = np.concatenate([cast(triangles, *pair).distance for pair in zip(origins, directions, strict=True)])
    pairs = [(origin, each) for origin, row in zip(origins, directions, strict=True) for each in row]
    expected, is_close = map(np.array, zip(*(by_trimesh(triangles, *pair) for pair in pairs), strict=True))
    compared = ~is_close
    same = np.isfinite(found) == np.isfinite(expected)
    hits = compared & np.isfinite(expected) & np.isfinite(found)
    worst = np.abs(found[hits] - expected[hits]).max()
    print(f"{len(found)} rays, {is_close.sum()} within {TOLERANCE_M:g} m of an edge left out, {hits.sum()} hits")
    print(f"hit or not otherwise: {(compared & ~same).sum()}; largest difference {worst:.2g} m")
    simple = simplify(triangles, MOST_TRIANGLES)
    few = np.concatenate([cast(simple.triangles, *pair).distance for pair in zip(origins, directions, strict=True)])
    both = np.isfinite(few) & np.isfinite(found)
    differences, one = np.abs(few[both] - found[both]), (np.isfinite(few) != np.isfinite(found)).sum()
    print(
        f"{len(triangles)} triangles simplified to {len(simple.triangles)}, stated error {1e3 * simple.error_m:.2g} mm"
    )
    percentiles = ", ".join(f"{1e3 * each:.2g}" for each in np.percentile(differences, [50.0, 95.0, 99.0]))
    print(
        f"difference of ranges, 50, 95 and 99 %: {percentiles} mm; one of the two met: {one / both.sum():.2%} of hits"
    )
    print(f"64 beams: {1e6 * time_of_beams(simple.triangles):.0f} us a run and tick, on one core")
    return int(worst > TOLERANCE_M or bool((compared & ~same).any()))


if __name__ == "__main__":
    raise SystemExit(main())
