"""Ray-traced views of a target: training data and reference of a radiance field."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling, sample_views
from rpojax.training.synthetic_data.ray_tracing import RayTracer
from rpojax.training.synthetic_data.view_cache import ViewCache

VIEWS_PER_BLOCK = 32

OnProgress = Callable[[int, int], None]
OnFirstBlock = Callable[[np.ndarray, np.ndarray], None]


@dataclasses.dataclass(frozen=True)
class Views:
    """Views of a target in its body axes T.

    Attributes:
        rotation: (n, 3, 3) `R_KT` of the camera axes
        position: (n, 3) camera in T [m]
        sun: (n, 3) unit vector to the Sun in T
        field_of_view_deg: of the whole square frame
        rgb: (n, p, p, 3) linear radiance on black, 1 = white level
        alpha: (n, p, p) fraction of the pixel that the target covers
        depth: (n, p, p) distance [m] times that fraction
    """

    rotation: np.ndarray
    position: np.ndarray
    sun: np.ndarray
    field_of_view_deg: float
    rgb: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray

    def __len__(self) -> int:
        return len(self.position)


def ray_trace_views(
    mesh: TargetMesh,
    sampling: ViewSampling,
    folder: Path | None = None,
    on_progress: OnProgress = lambda done, total: None,
    on_first_block: OnFirstBlock = lambda rgb, alpha: None,
) -> Views:
    """Ray-traced views; with a folder, finished blocks are stored and an interrupted call continues.

    `on_first_block` is called with colour (n, p, p, 3) and alpha (n, p, p) of the first block as soon as it is done.
    """
    rotations, positions, suns = sample_views(mesh, sampling)
    cache = ViewCache(folder, mesh, sampling) if folder else None
    blocks = []
    tracer = None
    for start in range(0, sampling.count, VIEWS_PER_BLOCK):
        chosen = range(start, min(start + VIEWS_PER_BLOCK, sampling.count))
        block = cache.read(start, len(chosen)) if cache else None
        if block is None:
            tracer = tracer or RayTracer(mesh, sampling)
            frames = []
            for index in chosen:
                frames.append(tracer.trace(rotations[index], positions[index], suns[index], index))
                on_progress(index + 1, sampling.count)
            # In half precision as stored, so that a call that continues has the same views.
            block = np.stack(frames).astype(np.float16)
            if cache:
                cache.write(start, block)
        if start == 0:
            on_first_block(block[..., :3], block[..., 3])
        on_progress(chosen.stop, sampling.count)
        blocks.append(block)
    channels = np.concatenate(blocks).astype(np.float32)
    return Views(
        rotation=rotations,
        position=positions,
        sun=suns,
        field_of_view_deg=sampling.field_of_view_deg,
        rgb=channels[..., :3],
        alpha=np.clip(channels[..., 3], 0.0, 1.0),
        depth=channels[..., 4],
    )
