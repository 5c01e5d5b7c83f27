"""Ray-traced views of a target: training data and reference of a radiance field."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.optional_packages import require_package
from rpojax.training.synthetic_data.meshes.target_mesh import MeshPart, TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling, sample_views
from rpojax.training.synthetic_data.view_cache import ViewCache, mesh_digest
from rpojax.vision.pinhole import pixel_directions

_SUN_IRRADIANCE = 2.2
_WEAK_EARTH_SHINE = 0.25
_NEAR_CLIP_M = 0.01
_FORMAT = 2
VIEWS_PER_BLOCK = 32
OnProgress = Callable[[int, int], None]
OnFirstBlock = Callable[[np.ndarray, np.ndarray], None]


class RayTracer:
    """Mitsuba scene of one mesh, rendered one view at a time."""

    def __init__(self, mesh: TargetMesh, sampling: ViewSampling) -> None:
        mitsuba = require_package("mitsuba")
        if mitsuba.variant() is None:
            mitsuba.set_variant("scalar_rgb")
        self._mitsuba = mitsuba
        self._sampling = sampling
        shapes = {f"part{i}": mesh_shape(mitsuba, part, f"part{i}") for i, part in enumerate(mesh.parts)}
        sun = {
            "type": "directional",
            "direction": [0.0, 0.0, 1.0],
            "irradiance": {"type": "rgb", "value": _SUN_IRRADIANCE},
        }
        self._sunlit_scene = mitsuba.load_dict({"type": "scene", **shapes, "sun": sun})
        self._sun_parameters = mitsuba.traverse(self._sunlit_scene)
        self._color_integrator = mitsuba.load_dict({"type": "path", "max_depth": 4, "hide_emitters": True})
        self._near_plane_distance = _near_plane_distance(sampling)
        self._depth_integrator = mitsuba.load_dict({"type": "depth"})
        shine = {
            "type": "constant",
            "radiance": {"type": "rgb", "value": sampling.earth_shine * _SUN_IRRADIANCE / np.pi},
        }
        # In a scene of its own: choosing one of two lights for each sample would add noise.
        self._earth_shine = (
            mitsuba.load_dict({"type": "scene", **shapes, "sky": shine}) if sampling.earth_shine > 0.0 else None
        )

    def trace(self, rotation: np.ndarray, position: np.ndarray, sun: np.ndarray, seed: int) -> np.ndarray:
        """(p, p, 5) linear colour, alpha and depth of one view."""
        sampling, number = self._sampling, (seed + 1 + 100_003 * self._sampling.seed) % 2**31
        # One scene for all views: the search tree of a large mesh takes longer to build than a view to render.
        self._sun_parameters["sun.to_world"] = self._mitsuba.ScalarTransform4f(rotation_from_z(-sun).tolist())
        self._sun_parameters.update()
        image = self._integrate(
            self._color_integrator, self._sunlit_scene, rotation, position, sampling.samples, number
        )
        if self._earth_shine is not None:
            # Weak light adds little noise, so fewer samples do.
            samples = sampling.samples if sampling.earth_shine > _WEAK_EARTH_SHINE else -(-sampling.samples // 4)
            image[..., :3] += self._integrate(
                self._color_integrator, self._earth_shine, rotation, position, samples, number
            )[..., :3]
        depth = self._integrate(
            self._depth_integrator, self._sunlit_scene, rotation, position, min(sampling.samples, 16), number
        )
        # The two passes have their own samples: the distance is that of the depth pass, the alpha that of the image.
        # Mitsuba measures depth from the near plane.
        distance = depth[..., :1] / np.maximum(depth[..., 3:4], 1e-6) + self._near_plane_distance[..., None]
        image = np.nan_to_num(np.concatenate([image, distance * image[..., 3:4]], axis=2), posinf=0.0, neginf=0.0)
        image[..., :3] = np.clip(image[..., :3], 0.0, 100.0)
        return image

    def _integrate(
        self, integrator: Any, scene: Any, rotation: np.ndarray, position: np.ndarray, samples: int, seed: int
    ) -> np.ndarray:
        mitsuba, sampling = self._mitsuba, self._sampling
        # The camera of mitsuba has x to the left and y up.
        axes = np.eye(4)
        axes[:3, :3] = (rotation * np.array([-1.0, -1.0, 1.0])[:, None]).T
        axes[:3, 3] = position
        film = {"type": "hdrfilm", "width": sampling.size_px, "height": sampling.size_px, "rfilter": {"type": "box"}}
        sensor = mitsuba.load_dict(
            {
                "type": "perspective",
                "fov": sampling.field_of_view_deg,
                "near_clip": _NEAR_CLIP_M,
                "far_clip": 1e4,
                "to_world": mitsuba.ScalarTransform4f(axes.tolist()),
                "film": {**film, "pixel_format": "rgba"},
                "sampler": {"type": "independent", "sample_count": samples},
            }
        )
        return np.array(integrator.render(scene, sensor, seed=seed), dtype=np.float32)


def _near_plane_distance(sampling: ViewSampling) -> np.ndarray:
    """Distance (p, p) from the camera to the near plane along the ray of each pixel [m]."""
    directions = pixel_directions(sampling.size_px, sampling.field_of_view_deg)
    return _NEAR_CLIP_M / directions[..., 2]


def rotation_from_z(direction: np.ndarray) -> np.ndarray:
    """A rotation (4, 4) that takes z to a direction (3,)."""
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    x /= np.linalg.norm(x)
    rotation = np.eye(4)
    rotation[:3, :3] = np.stack([x, np.cross(direction, x), direction], axis=1)
    return rotation


def mesh_shape(mitsuba: Any, part: MeshPart, name: str) -> Any:
    """Mesh of mitsuba, flat-shaded."""
    material = part.material
    if material.texture is not None and part.uv is not None:
        color: dict[str, Any] = {
            "type": "bitmap",
            "bitmap": mitsuba.Bitmap(np.array(material.texture, order="C")),
            "raw": False,
        }
    else:
        color = {"type": "rgb", "value": list(material.color)}
    surface = {
        "type": "principled",
        "base_color": color,
        "metallic": material.metallic,
        "roughness": material.roughness,
        "specular": 0.5,
    }
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict({"type": "twosided", "material": surface})
    properties["face_normals"] = True
    mesh = mitsuba.Mesh(
        name,
        len(part.vertices),
        len(part.faces),
        props=properties,
        has_vertex_normals=False,
        has_vertex_texcoords=part.uv is not None,
    )
    content = mitsuba.traverse(mesh)
    content["vertex_positions"] = part.vertices.astype(np.float32).ravel()
    content["faces"] = part.faces.astype(np.uint32).ravel()
    if part.uv is not None:
        content["vertex_texcoords"] = (part.uv * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32).ravel()
    content.update()
    return mesh


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
    settings = dataclasses.replace(sampling, count=0)
    cache = ViewCache(folder, f"{_FORMAT} {mesh_digest(mesh)} {settings}") if folder else None
    blocks = []
    tracer = None
    for start in range(0, sampling.count, VIEWS_PER_BLOCK):
        chosen = range(start, min(start + VIEWS_PER_BLOCK, sampling.count))
        found = cache.read(start, len(chosen), ("film",)) if cache else None
        if found is not None:
            block = found["film"]
        else:
            tracer = tracer or RayTracer(mesh, sampling)
            frames = []
            for index in chosen:
                frames.append(tracer.trace(rotations[index], positions[index], suns[index], index))
                on_progress(index + 1, sampling.count)
            # In half precision as stored, so that a call that continues has the same views.
            block = np.stack(frames).astype(np.float16)
            if cache:
                cache.write(start, {"film": block})
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
