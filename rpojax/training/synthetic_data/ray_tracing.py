"""Ray-traced views of a target (mitsuba), the truth that a field is trained on and judged by."""

import dataclasses
import hashlib
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.optional import require_package
from rpojax.training.synthetic_data.target_mesh import MeshPart, TargetMesh
from rpojax.vision.radiance_field.render_image import pixel_directions

PHASE_LIMIT_DEG = 110.0
FIELD_OF_VIEW_DEG = 26.0
FRAME_FILL = 0.82
"""Share of the frame's width that the ball around the target fills; its silhouette then fills about 60 %."""
_SUN_IRRADIANCE = 2.2
_WEAK_EARTH_SHINE = 0.25
_FORMAT = 2
_NEAR_CLIP_M = 0.01
VIEWS_PER_BLOCK = 32
"""Views that are kept together."""

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
        alpha: (n, p, p) share of the pixel that the target covers
        depth: (n, p, p) distance [m] times that share
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

    def first(self, count: int) -> "Views":
        """The first `count` views."""
        names = ("rotation", "position", "sun", "rgb", "alpha", "depth")
        return dataclasses.replace(self, **{name: getattr(self, name)[:count] for name in names})


@dataclasses.dataclass(frozen=True)
class ViewSampling:
    """How views are drawn: their number, frame, samples per pixel, range in units of the nominal one, largest phase
    angle, light from all sides (a stand-in for Earth-shine) relative to the Sun, and the seed."""

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
    """Middle [m] and radius [m] of the ball around a box (2, 3)."""
    return 0.5 * (bounds[0] + bounds[1]), 0.5 * float(np.linalg.norm(bounds[1] - bounds[0]))


def nominal_range(radius_m: float, field_of_view_deg: float = FIELD_OF_VIEW_DEG) -> float:
    """Distance [m] at which a ball fills the share `FILL` of the frame's width."""
    return radius_m / (FRAME_FILL * np.tan(np.radians(0.5 * field_of_view_deg)))


def unit_vectors(rng: np.random.Generator, count: int) -> np.ndarray:
    """Directions (n, 3), uniform on the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def sample_views(mesh: TargetMesh, sampling: ViewSampling) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations, positions and Suns of `shell.count` views; view i depends on the seed and i alone."""
    middle, radius = center_and_radius(mesh.bounds)
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
        positions.append(middle + distance * away)
        suns.append(sun)
    return np.stack(rotations), np.stack(positions), np.stack(suns)


def ray_trace_views(
    mesh: TargetMesh,
    sampling: ViewSampling,
    folder: Path | None = None,
    on_progress: OnProgress = lambda done, total: None,
    on_first_block: OnFirstBlock = lambda rgb, alpha: None,
) -> Views:
    """Ray-traces the views of a shell; with a folder, finished blocks are kept and an interrupted call resumes.

    `on_first` is given pictures (n, p, p, 3) and alpha (n, p, p) of the first block as soon as it is done.
    """
    rotations, positions, suns = sample_views(mesh, sampling)
    cache = _ViewCache(folder, mesh, sampling) if folder else None
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
            # Half precision, as blocks are kept: a call that resumes has the very same views.
            block = np.stack(frames).astype(np.float16)
            if cache:
                cache.write(start, block)
        if start == 0:
            on_first_block(block[..., :3], block[..., 3])
        on_progress(chosen.stop, sampling.count)
        blocks.append(block)
    film = np.concatenate(blocks).astype(np.float32)
    return Views(
        rotation=rotations,
        position=positions,
        sun=suns,
        field_of_view_deg=sampling.field_of_view_deg,
        rgb=film[..., :3],
        alpha=np.clip(film[..., 3], 0.0, 1.0),
        depth=film[..., 4],
    )


class _ViewCache:
    """Blocks of finished views in a folder that belongs to one mesh and one shell."""

    def __init__(self, folder: Path, mesh: TargetMesh, sampling: ViewSampling) -> None:
        self.folder = folder
        digest = hashlib.sha256()
        for part in mesh.parts:
            digest.update(np.ascontiguousarray(part.vertices).tobytes())
            digest.update(np.ascontiguousarray(part.faces).tobytes())
            digest.update(b"" if part.uv is None else np.ascontiguousarray(part.uv).tobytes())
            digest.update(repr(dataclasses.replace(part.material, texture=None)).encode())
            digest.update(b"" if part.material.texture is None else np.ascontiguousarray(part.material.texture).data)
        settings = dataclasses.replace(sampling, count=0)
        self.key = f"{_FORMAT} {digest.hexdigest()} {settings}"

    def _path(self, start: int) -> Path:
        return self.folder / f"views_{start:05d}.npz"

    def read(self, start: int, count: int) -> np.ndarray | None:
        """Finished views from `start` on, or None if they are missing, damaged or of another mesh or shell."""
        try:
            with np.load(self._path(start), allow_pickle=False) as content:
                if str(content["key"]) == self.key and len(content["film"]) >= count:
                    return content["film"][:count]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            pass
        return None

    def write(self, start: int, film: np.ndarray) -> None:
        """Keeps views; a file is either whole or not there."""
        path = self._path(start)
        partial = path.with_suffix(".part")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with partial.open("wb") as stream:
                np.savez_compressed(stream, film=film, key=np.array(self.key))
            partial.replace(path)
        except OSError as error:
            text = f"{path}: cannot be written ({error.strerror}), expected a folder for views"
            raise RpojaxError(text) from None


class RayTracer:
    """A scene of one mesh, of which frames are taken one at a time."""

    def __init__(self, mesh: TargetMesh, sampling: ViewSampling) -> None:
        mitsuba = require_package("mitsuba")
        if mitsuba.variant() is None:
            mitsuba.set_variant("scalar_rgb")
        self._mi = mitsuba
        self._sampling = sampling
        shapes = {f"part{i}": _shape(mitsuba, part, f"part{i}") for i, part in enumerate(mesh.parts)}
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
        # In a scene of its own: drawing one of two lights for each sample would make the picture noisy.
        self._earth_shine = (
            mitsuba.load_dict({"type": "scene", **shapes, "sky": shine}) if sampling.earth_shine > 0.0 else None
        )

    def trace(self, rotation: np.ndarray, position: np.ndarray, sun: np.ndarray, seed: int) -> np.ndarray:
        """(p, p, 5) linear colour, alpha and depth of one view."""
        shell, number = self._sampling, (seed + 1 + 100_003 * self._sampling.seed) % 2**31
        # One scene for all views: the search tree of a large mesh takes longer to build than a view to trace.
        self._sun_parameters["sun.to_world"] = self._mi.ScalarTransform4f(_rotation_from_z(-sun).tolist())
        self._sun_parameters.update()
        image = self._integrate(self._color_integrator, self._sunlit_scene, rotation, position, shell.samples, number)
        if self._earth_shine is not None:
            # Of weak light the noise is weak, too.
            samples = shell.samples if shell.earth_shine > _WEAK_EARTH_SHINE else -(-shell.samples // 4)
            image[..., :3] += self._integrate(
                self._color_integrator, self._earth_shine, rotation, position, samples, number
            )[..., :3]
        depth = self._integrate(
            self._depth_integrator, self._sunlit_scene, rotation, position, min(shell.samples, 16), number
        )
        # The two passes draw their own samples: the distance is that of the depth pass, the share that of the picture.
        # And mitsuba counts it from the plane that is nearest to be seen.
        distance = depth[..., :1] / np.maximum(depth[..., 3:4], 1e-6) + self._near_plane_distance[..., None]
        image = np.nan_to_num(np.concatenate([image, distance * image[..., 3:4]], axis=2), posinf=0.0, neginf=0.0)
        image[..., :3] = np.clip(image[..., :3], 0.0, 100.0)
        return image

    def _integrate(
        self, integrator: Any, scene: Any, rotation: np.ndarray, position: np.ndarray, samples: int, seed: int
    ) -> np.ndarray:
        mi, shell = self._mi, self._sampling
        # mitsuba's camera has x to the left and y up.
        axes = np.eye(4)
        axes[:3, :3] = (rotation * np.array([-1.0, -1.0, 1.0])[:, None]).T
        axes[:3, 3] = position
        film = {"type": "hdrfilm", "width": shell.size_px, "height": shell.size_px, "rfilter": {"type": "box"}}
        sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": shell.field_of_view_deg,
                "near_clip": _NEAR_CLIP_M,
                "far_clip": 1e4,
                "to_world": mi.ScalarTransform4f(axes.tolist()),
                "film": {**film, "pixel_format": "rgba"},
                "sampler": {"type": "independent", "sample_count": samples},
            }
        )
        return np.array(integrator.render(scene, sensor, seed=seed), dtype=np.float32)


def _near_plane_distance(sampling: ViewSampling) -> np.ndarray:
    """Distance (p, p) from the camera along each pixel's ray to the nearest plane that is seen [m]."""
    tangents = pixel_directions(sampling.size_px, sampling.field_of_view_deg)
    return _NEAR_CLIP_M / tangents[..., 2]


def _rotation_from_z(direction: np.ndarray) -> np.ndarray:
    """A rotation (4, 4) that takes z to a direction (3,)."""
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    x /= np.linalg.norm(x)
    turn = np.eye(4)
    turn[:3, :3] = np.stack([x, np.cross(direction, x), direction], axis=1)
    return turn


def _shape(mi: Any, part: MeshPart, name: str) -> Any:
    """A mesh of mitsuba, flat-shaded."""
    material = part.material
    if material.texture is not None and part.uv is not None:
        color: dict[str, Any] = {
            "type": "bitmap",
            "bitmap": mi.Bitmap(np.array(material.texture, order="C")),
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
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "twosided", "material": surface})
    properties["face_normals"] = True
    mesh = mi.Mesh(
        name,
        len(part.vertices),
        len(part.faces),
        props=properties,
        has_vertex_normals=False,
        has_vertex_texcoords=part.uv is not None,
    )
    content = mi.traverse(mesh)
    content["vertex_positions"] = part.vertices.astype(np.float32).ravel()
    content["faces"] = part.faces.astype(np.uint32).ravel()
    if part.uv is not None:
        content["vertex_texcoords"] = (part.uv * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32).ravel()
    content.update()
    return mesh


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """sRGB code values of linear radiance, clipped to 0..1 (IEC 61966-2-1)."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.maximum(clipped, 1e-9) ** (1 / 2.4) - 0.055)


def batch_slices(count: int, size: int) -> Iterator[slice]:
    """Slices that cover `count` things, `size` at a time."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))
