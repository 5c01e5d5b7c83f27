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
_ALL_SIDES_DEG = 180.0
_FILL_MAP_ROWS = 90
_Y_TO_Z = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_NEAR_CLIP_M = 0.01
_FORMAT = 3
VIEWS_PER_BLOCK = 32
OnProgress = Callable[[int, int], None]
OnFirstBlock = Callable[[np.ndarray, np.ndarray], None]


class RayTracer:
    """Mitsuba scenes of one mesh, under the Sun and under fill light, rendered one view at a time."""

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
        # Two scenes: choosing one of two lights for each sample would add noise.
        self._sunlit_scene, self._filled_scene = (
            mitsuba.load_dict({"type": "scene", **shapes, "light": light})
            for light in (sun, _fill_light(mitsuba, sampling.fill_half_angle_deg))
        )
        self._sun_parameters = mitsuba.traverse(self._sunlit_scene)
        self._fill_parameters = mitsuba.traverse(self._filled_scene)
        self._color_integrator = mitsuba.load_dict({"type": "path", "max_depth": 4, "hide_emitters": True})
        self._near_plane_distance = _near_plane_distance(sampling)
        self._depth_integrator = mitsuba.load_dict({"type": "depth"})

    def trace(
        self, rotation: np.ndarray, position: np.ndarray, sun: np.ndarray, fill: np.ndarray, seed: int
    ) -> np.ndarray:
        """(p, p, 8) linear colour under the Sun and under fill light of its irradiance, alpha and depth of one view."""
        sampling, number = self._sampling, (seed + 1 + 100_003 * self._sampling.seed) % 2**31
        # One scene for all views: the search tree of a large mesh takes longer to build than a view to render.
        self._sun_parameters["light.to_world"] = self._mitsuba.ScalarTransform4f(rotation_from_z(-sun).tolist())
        self._sun_parameters.update()
        image = self._integrate(
            self._color_integrator, self._sunlit_scene, rotation, position, sampling.samples, number
        )
        if sampling.fill_half_angle_deg < _ALL_SIDES_DEG:
            # The pole of a map of light is its y axis.
            to_world = (rotation_from_z(fill) @ _Y_TO_Z).tolist()
            self._fill_parameters["light.to_world"] = self._mitsuba.ScalarTransform4f(to_world)
            self._fill_parameters.update()
        # Fill light is smooth and weaker than the Sun's, so fewer samples do.
        samples = -(-sampling.samples // 2)
        filled = self._integrate(self._color_integrator, self._filled_scene, rotation, position, samples, number)
        depth = self._integrate(
            self._depth_integrator, self._sunlit_scene, rotation, position, min(sampling.samples, 16), number
        )
        # The passes have their own samples: the distance is that of the depth pass, the alpha that of the image.
        # Mitsuba measures depth from the near plane.
        distance = depth[..., :1] / np.maximum(depth[..., 3:4], 1e-6) + self._near_plane_distance[..., None]
        alpha = image[..., 3:4]
        image = np.concatenate([image[..., :3], filled[..., :3], alpha, distance * alpha], axis=2)
        image = np.nan_to_num(image, posinf=0.0, neginf=0.0)
        image[..., :6] = np.clip(image[..., :6], 0.0, 100.0)
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


def _fill_light(mitsuba: Any, half_angle_deg: float) -> dict[str, Any]:
    """Even light from a cone around the y axis, of the Sun's irradiance on a surface that faces it."""
    if half_angle_deg >= _ALL_SIDES_DEG:
        return {"type": "constant", "radiance": {"type": "rgb", "value": _SUN_IRRADIANCE / np.pi}}
    # Rows of the map are angles from the y axis; the outermost is lit in part.
    row = _ALL_SIDES_DEG / _FILL_MAP_ROWS
    lit = np.clip(half_angle_deg / row - np.arange(_FILL_MAP_ROWS), 0.0, 1.0)
    radiance = _SUN_IRRADIANCE / (np.pi * np.sin(np.radians(min(half_angle_deg, 90.0))) ** 2)
    picture = np.broadcast_to((radiance * lit)[:, None, None], (_FILL_MAP_ROWS, 2 * _FILL_MAP_ROWS, 3))
    return {"type": "envmap", "bitmap": mitsuba.Bitmap(np.array(picture, np.float32, order="C")), "scale": 1.0}


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
        fill: (n, 3) unit vector to the middle of the fill light in T
        field_of_view_deg: of the whole square frame
        sunlit: (n, p, p, 3) linear radiance under the Sun on black, 1 = white level
        filled: (n, p, p, 3) the same under fill light of the Sun's irradiance
        alpha: (n, p, p) fraction of the pixel that the target covers
        depth: (n, p, p) distance [m] times that fraction
    """

    rotation: np.ndarray
    position: np.ndarray
    sun: np.ndarray
    fill: np.ndarray
    field_of_view_deg: float
    sunlit: np.ndarray
    filled: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray

    def __len__(self) -> int:
        return len(self.position)

    def radiance(self, fill_irradiance: float) -> np.ndarray:
        """Linear radiance (n, p, p, 3) under the Sun and fill light of an irradiance by the Sun's."""
        return self.sunlit + np.float32(fill_irradiance) * self.filled


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
    poses = sample_views(mesh, sampling)
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
                frames.append(
                    tracer.trace(
                        poses.rotation[index], poses.position[index], poses.sun[index], poses.fill[index], index
                    )
                )
                on_progress(index + 1, sampling.count)
            # In half precision as stored, so that a call that continues has the same views.
            block = np.stack(frames).astype(np.float16)
            if cache:
                cache.write(start, {"film": block})
        if start == 0:
            on_first_block(block[..., :3], block[..., 6])
        on_progress(chosen.stop, sampling.count)
        blocks.append(block)
    channels = np.concatenate(blocks).astype(np.float32)
    return Views(
        rotation=poses.rotation,
        position=poses.position,
        sun=poses.sun,
        fill=poses.fill,
        field_of_view_deg=sampling.field_of_view_deg,
        sunlit=channels[..., :3],
        filled=channels[..., 3:6],
        alpha=np.clip(channels[..., 6], 0.0, 1.0),
        depth=channels[..., 7],
    )
