"""Ray-traced sprites of spacecraft: radiance under the Sun and under uniform light, with alpha."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rpojax.training.synthetic_data import ray_traced_views
from rpojax.training.synthetic_data.meshes import packaged_target, procedural_spacecraft
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling

SIZE_PX = 160
SAMPLES = 16
_TARGET_FRACTION = 0.25
_MIN_ALPHA = 0.02


@dataclasses.dataclass(frozen=True)
class Sprite:
    """One view of a spacecraft, cropped to its silhouette: premultiplied linear radiance, 1 = white level.

    Attributes:
        craft: name of the spacecraft
        sunlit: (h, w, 3) under the Sun alone
        earth_shine: (h, w, 3) under uniform light from all sides of the same irradiance
        alpha: (h, w) fraction of the pixel that the spacecraft covers
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
    """`views_per_craft` sprites of each of `craft_count` spacecraft and, a quarter of all, of the packaged target.

    Those held out are of other spacecraft and views. Finished ones are stored in the folder.
    """
    half = 1 if held_out else 0
    target_views = max(1, round(_TARGET_FRACTION / (1.0 - _TARGET_FRACTION) * craft_count * views_per_craft))
    total = craft_count * views_per_craft + target_views
    # The camera of a run rarely sees its target against the Sun; the others are also seen as silhouettes.
    jobs = [(packaged_target.packaged_target(), _view_sampling(target_views, [seed, half, 0], 120.0))]
    for index in range(craft_count):
        jobs.append(
            (
                procedural_spacecraft.random_spacecraft([seed, half, index]),
                _view_sampling(views_per_craft, [seed, half, 1 + index], 150.0),
            )
        )
    found: list[Sprite] = []
    for number, (mesh, sampling) in enumerate(jobs):
        found += _sprites(mesh, sampling, folder / f"{'held_out' if held_out else 'seen'}_{number:04d}")
        on_progress(len(found), total)
    return found


def _view_sampling(views: int, seed: list[int], phase_limit_deg: float) -> ViewSampling:
    number = int(np.random.default_rng(seed).integers(1 << 20))
    return ViewSampling(
        views, size_px=SIZE_PX, samples=SAMPLES, phase_limit_deg=phase_limit_deg, fill_half_angle_deg=180.0, seed=number
    )


def _sprites(mesh: TargetMesh, sampling: ViewSampling, folder: Path) -> list[Sprite]:
    views = ray_traced_views.ray_trace_views(mesh, sampling, folder)
    sprites = []
    for index in range(len(views)):
        alpha = views.alpha[index]
        rows, columns = np.nonzero(alpha.max(axis=1) > _MIN_ALPHA)[0], np.nonzero(alpha.max(axis=0) > _MIN_ALPHA)[0]
        if len(rows) == 0:
            continue
        crop = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        sprites.append(Sprite(mesh.name, views.sunlit[index][crop], views.filled[index][crop], alpha[crop]))
    return sprites
