"""Ray-traced regions around a target, with each light apart, and which landmarks are in sight; kept in a folder.

Light adds up, so one view with the Sun in two directions, the lamp and uniform light traced apart gives pictures in any
mix of them.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from rpojax.optional_packages import require_package
from rpojax.training.pose.view_sampling import (
    SUNS,
    LandmarkView,
    LandmarkViewSampling,
    Region,
    region_of,
    sample_view,
)
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.ray_traced_views import mesh_shape, rotation_from_z
from rpojax.training.synthetic_data.view_cache import ViewCache, mesh_digest
from rpojax.vision.surface.landmark_file import landmark_digest
from rpojax.vision.surface.landmarks import Landmarks
from rpojax.vision.surface.surface_corners import body_size

_FORMAT = 1
_BLOCK = 32
LIGHTS = SUNS + 2
"""Suns, the lamp, and uniform light from all sides, each of the same irradiance at the target's origin."""
_ALL_LIGHTS = np.ones(LIGHTS, bool)
CHANNELS = 3 * LIGHTS + 1
"""Colours of each light, and the covered fraction."""
_IRRADIANCE = 2.2
_BRIGHTEST = 6.0
"""Radiance of the largest code; brighter glints are cut."""
_GAMMA = 2.2
_LIFT = 1e-4
OnProgress = Callable[[int, int], None]


def encode(values: np.ndarray) -> np.ndarray:
    """8 bit codes of linear radiance, finer where it is dark."""
    scaled = np.clip(values / _BRIGHTEST, 0.0, 1.0) ** (1.0 / _GAMMA)
    return np.round(255.0 * scaled).astype(np.uint8)


DECODED = (_BRIGHTEST * (np.arange(256) / 255.0) ** _GAMMA).astype(np.float32)
"""Linear radiance of each code."""


class LandmarkRayTracer:
    """Scenes of one mesh under each light."""

    def __init__(self, mesh: TargetMesh, samples: int) -> None:
        mitsuba = require_package("mitsuba")
        if mitsuba.variant() is None:
            mitsuba.set_variant("scalar_rgb")
        self._mitsuba, self._samples = mitsuba, samples
        shapes = {f"part{i}": mesh_shape(mitsuba, part, f"part{i}") for i, part in enumerate(mesh.parts)}
        sun = {"type": "directional", "direction": [0.0, 0.0, 1.0], "irradiance": {"type": "rgb", "value": _IRRADIANCE}}
        lamp = {"type": "point", "position": [0.0, 0.0, 9.0], "intensity": {"type": "rgb", "value": 1.0}}
        sky = {"type": "constant", "radiance": {"type": "rgb", "value": _IRRADIANCE / np.pi}}
        self._sun, self._lamp, self._sky = (
            mitsuba.load_dict({"type": "scene", **shapes, "light": light}) for light in (sun, lamp, sky)
        )
        self._sun_parameters, self._lamp_parameters = mitsuba.traverse(self._sun), mitsuba.traverse(self._lamp)
        self._integrator = mitsuba.load_dict({"type": "path", "max_depth": 4, "hide_emitters": True})

    def trace(self, view: LandmarkView, region: Region, seed: int, lights: np.ndarray = _ALL_LIGHTS) -> np.ndarray:
        """Linear radiance (p, p, 13) of a region under each light, and the covered fraction.

        Of `lights` (4,) those that are False are left dark.
        """
        sensor = self._sensor(view, region)
        images: list[np.ndarray | None] = [None] * LIGHTS
        for number in np.flatnonzero(lights):
            images[number] = self._render(self._lit_scene(view, int(number)), sensor, seed + int(number))
        found = [image for image in images if image is not None]
        dark = np.zeros_like(found[0][..., :3])
        coverage = np.clip(np.mean([image[..., 3:4] for image in found], axis=0), 0.0, 1.0)
        return np.concatenate([*(dark if image is None else image[..., :3] for image in images), coverage], axis=2)

    def _lit_scene(self, view: LandmarkView, light: int) -> Any:
        """Scene under one of the lights, placed for a view."""
        if light < SUNS:
            to_world = rotation_from_z(-view.suns[light]).tolist()
            self._sun_parameters["light.to_world"] = self._mitsuba.ScalarTransform4f(to_world)
            self._sun_parameters.update()
            return self._sun
        if light == SUNS:
            self._lamp_parameters["light.position"] = view.lamp.tolist()
            # Of the same irradiance as the Sun's at the target's origin.
            self._lamp_parameters["light.intensity.value"] = _IRRADIANCE * float(view.lamp @ view.lamp)
            self._lamp_parameters.update()
            return self._lamp
        return self._sky

    def visible(self, view: LandmarkView, landmarks: Landmarks, size_m: float) -> np.ndarray:
        """Whether the ray from each landmark to the camera is free (n,); `size_m` is that of the body."""
        positions, normals = np.asarray(landmarks.positions), np.asarray(landmarks.normals)
        starts = positions + _LIFT * size_m * normals
        rays = view.position - starts
        lengths = np.linalg.norm(rays, axis=1)
        return np.array(
            [
                not self._sky.ray_test(
                    self._mitsuba.Ray3f(start.tolist(), (ray / length).tolist(), float(length), 0.0, [])
                )
                for start, ray, length in zip(starts, rays, lengths, strict=True)
            ]
        )

    def _render(self, scene: Any, sensor: Any, seed: int) -> np.ndarray:
        image = np.array(self._integrator.render(scene, sensor, seed=seed % 2**31), dtype=np.float32)
        return np.nan_to_num(image, posinf=0.0, neginf=0.0)

    def _sensor(self, view: LandmarkView, region: Region) -> Any:
        mitsuba = self._mitsuba
        # The camera of mitsuba has x to the left and y up.
        axes = np.eye(4)
        axes[:3, :3] = (view.rotation * np.array([-1.0, -1.0, 1.0])[:, None]).T
        axes[:3, 3] = view.position
        film = {"type": "hdrfilm", "width": region.size_px, "height": region.size_px, "rfilter": {"type": "box"}}
        offset = region.middle / region.side
        return mitsuba.load_dict(
            {
                "type": "perspective",
                "fov": float(np.degrees(2.0 * np.arctan(0.5 * region.side))),
                "principal_point_offset_x": float(offset[0]),
                "principal_point_offset_y": float(offset[1]),
                "near_clip": 0.01,
                "far_clip": 1e4,
                "to_world": mitsuba.ScalarTransform4f(axes.tolist()),
                "film": {**film, "pixel_format": "rgba"},
                "sampler": {"type": "independent", "sample_count": self._samples},
            }
        )


@dataclasses.dataclass(frozen=True)
class LandmarkViews:
    """Views with their labels.

    Attributes:
        codes: (n, 160, 160, 13) 8 bit codes of the radiance of each light (see `encode`); coverage by 255
        places: (n, k, 2) landmarks in the region [px]
        visible: (n, k) whether a landmark is in sight past the target itself
        outline: (n, m, 2) corners of the convex outline of the target in the region, the last one repeated [px]
        center: (n, 2) principal point in the region [px]
        focal_px: (n,) in pixels of the region
        half_frame: (n,) tangent of half of the field of view
        range_m: (n,)
    """

    codes: np.ndarray
    places: np.ndarray
    visible: np.ndarray
    outline: np.ndarray
    center: np.ndarray
    focal_px: np.ndarray
    half_frame: np.ndarray
    range_m: np.ndarray

    def __len__(self) -> int:
        return len(self.codes)


def trace_landmark_views(
    mesh: TargetMesh,
    landmarks: Landmarks,
    sampling: LandmarkViewSampling,
    folder: Path,
    on_progress: OnProgress = lambda done, total: None,
) -> LandmarkViews:
    """Views of a target; finished blocks are stored in the folder, and an interrupted call continues."""
    axis = None if landmarks.port_axis is None else np.asarray(landmarks.port_axis)
    hull = convex_corners(mesh)
    size_m = body_size(np.concatenate([part.vertices[part.faces] for part in mesh.parts]))
    views = [sample_view(sampling, index, axis) for index in range(sampling.count)]
    regions = [region_of(view, hull) for view in views]
    positions = np.asarray(landmarks.positions)
    cache, tracer = ViewCache(folder, views_key(mesh, landmarks, sampling)), None
    codes, visible = [], []
    for start in range(0, sampling.count, _BLOCK):
        chosen = range(start, min(start + _BLOCK, sampling.count))
        block = cache.read(start, len(chosen), ("codes", "visible"))
        if block is None:
            tracer = tracer or LandmarkRayTracer(mesh, sampling.samples)
            frames, seen = [], []
            for index in chosen:
                seed = (index * (LIGHTS + 1) + 100_003 * sampling.seed + 7919 * sampling.stream) % 2**31
                film = tracer.trace(views[index], regions[index], seed)
                frames.append(np.concatenate([encode(film[..., :-1]), np.round(255.0 * film[..., -1:])], axis=2))
                seen.append(tracer.visible(views[index], landmarks, size_m))
                on_progress(index + 1, sampling.count)
            block = {"codes": np.stack(frames).astype(np.uint8), "visible": np.stack(seen)}
            cache.write(start, block)
        codes.append(block["codes"])
        visible.append(block["visible"])
        on_progress(chosen.stop, sampling.count)
    pairs = list(zip(views, regions, strict=True))
    return LandmarkViews(
        codes=np.concatenate(codes),
        places=np.stack([region.to_pixels(view.tangents(positions)) for view, region in pairs]),
        visible=np.concatenate(visible),
        outline=_padded([_outline(region.to_pixels(view.tangents(hull))) for view, region in pairs]),
        center=np.stack([region.to_pixels(np.zeros((1, 2)))[0] for region in regions]),
        focal_px=np.array([region.focal_px for region in regions]),
        half_frame=np.array([view.half_frame for view in views]),
        range_m=np.array([view.range_m for view in views]),
    )


def convex_corners(mesh: TargetMesh) -> np.ndarray:
    """Corners (n, 3) of the convex hull of a mesh [m]."""
    vertices = np.unique(np.concatenate([part.vertices for part in mesh.parts]), axis=0)
    return vertices[ConvexHull(vertices).vertices]


def views_key(mesh: TargetMesh, landmarks: Landmarks, sampling: LandmarkViewSampling) -> str:
    """Key of stored views, which tells them from those of another mesh, of other landmarks or of another sampling."""
    settings = dataclasses.replace(sampling, count=0)
    return f"{_FORMAT} {mesh_digest(mesh)} {landmark_digest(landmarks)} {settings}"


def _outline(points: np.ndarray) -> np.ndarray:
    """Corners (m, 2) of the convex outline of points (n, 2)."""
    return points[ConvexHull(points).vertices]


def _padded(outlines: list[np.ndarray]) -> np.ndarray:
    """Outlines of different lengths in one array, the last corner repeated."""
    most = max(map(len, outlines))
    return np.stack([np.concatenate([each, np.repeat(each[-1:], most - len(each), axis=0)]) for each in outlines])
