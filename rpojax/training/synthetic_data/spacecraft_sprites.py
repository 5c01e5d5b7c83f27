"""Ray-traced sprites of many spacecraft: what the Sun lights and what light from all sides adds, with alpha."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rpojax.training.synthetic_data import procedural_spacecraft, ray_tracing, target_mesh
from rpojax.training.synthetic_data.ray_tracing import ViewSampling
from rpojax.training.synthetic_data.target_mesh import TargetMesh

SIZE_PX = 160
SAMPLES = 16
_TARGET_FRACTION = 0.25
_MIN_ALPHA = 0.02


@dataclasses.dataclass(frozen=True)
class Sprite:
    """One view of a spacecraft, cut to its silhouette: premultiplied linear radiance, 1 = white level.

    Attributes:
        craft: name of the spacecraft
        sun: (h, w, 3) under the Sun alone
        shine: (h, w, 3) under light from all sides that brings as much in all
        alpha: (h, w) share of the pixel that the spacecraft covers
    """

    craft: str
    sunlit: np.ndarray
    earth_shine: np.ndarray
    alpha: np.ndarray


def trace_sprites(
    folder: Path,
    craft_count: int,
    views_per_craft: int,
    seed: int,
    held_out: bool,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Sprite]:
    """`views` sprites of each of `craft` spacecraft and, a quarter of all, of the packaged target.

    Those held out are of other spacecraft and of other views. Finished ones are kept in the folder.
    """
    half = 1 if held_out else 0
    target_views = max(1, round(_TARGET_FRACTION / (1.0 - _TARGET_FRACTION) * craft_count * views_per_craft))
    total = craft_count * views_per_craft + target_views
    # A target in the flight camera is rarely seen against the Sun; the others are, as a silhouette.
    jobs = [(target_mesh.packaged_target(), _view_sampling(target_views, [seed, half, 0], 120.0))]
    for index in range(craft_count):
        jobs.append(
            (
                procedural_spacecraft.random_spacecraft([seed, half, index]),
                _view_sampling(views_per_craft, [seed, half, 1 + index], 150.0),
            )
        )
    found: list[Sprite] = []
    for number, (mesh, shell) in enumerate(jobs):
        found += _sprites(mesh, shell, folder / f"{'held_out' if held_out else 'seen'}_{number:04d}")
        on_progress(len(found), total)
    return found


def _view_sampling(views: int, seed: list[int], phase_limit_deg: float) -> ViewSampling:
    number = int(np.random.default_rng(seed).integers(1 << 20))
    return ViewSampling(
        views, size_px=SIZE_PX, samples=SAMPLES, phase_limit_deg=phase_limit_deg, earth_shine=0.0, seed=number
    )


def _sprites(mesh: TargetMesh, sampling: ViewSampling, folder: Path) -> list[Sprite]:
    sun = ray_tracing.ray_trace_views(mesh, sampling, folder / "sun")
    # The same random numbers make the same sunlit picture: what the second one has more is the light from all sides.
    both = ray_tracing.ray_trace_views(mesh, dataclasses.replace(sampling, earth_shine=1.0), folder / "both")
    sprites = []
    for index in range(len(sun)):
        alpha = sun.alpha[index]
        rows, columns = np.nonzero(alpha.max(axis=1) > _MIN_ALPHA)[0], np.nonzero(alpha.max(axis=0) > _MIN_ALPHA)[0]
        if len(rows) == 0:
            continue
        cut = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        lit, more = sun.rgb[index][cut], both.rgb[index][cut]
        sprites.append(Sprite(mesh.name, lit, np.maximum(more - lit, 0.0), alpha[cut]))
    return sprites
