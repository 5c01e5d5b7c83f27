"""Meshes in glTF 2.0: the triangles of its scene with their materials.

Source: Khronos Group, glTF 2.0 Specification, sections 3.5, 3.7 and 3.9.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.gltf_file import GltfFile
from rpojax.training.synthetic_data.meshes.formats.mesh_source import (
    BEYOND,
    FACE_LIMIT,
    MeshSource,
    Surface,
    scaled_texture,
)
from rpojax.training.synthetic_data.meshes.target_mesh import Material

_MIN_ROUGHNESS = 0.2
_KNOWN_EXTENSIONS = frozenset({"KHR_texture_transform", "KHR_mesh_quantization", "EXT_texture_webp"})
"""Extensions that are read as they say."""
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_KNOWN_ATTRIBUTES = frozenset({"POSITION", "NORMAL", "TANGENT", "COLOR_0"})
"""Attributes that are used, or that change no flat-shaded triangle."""
_REPEAT = 10497
_LONGEST_ROUNDING = 0.01
"""Of the length of a unit quaternion."""
_LARGEST_COLOR = 1.0 + 1e-6
_LEAST_SPREAD = 1.5 / 255.0
"""Differences of colours and reflection below this are not noted."""


@dataclasses.dataclass(frozen=True)
class _Look:
    """A material of the file.

    Attributes:
        material: its colour is that of `factor` alone
        factor: (3,) linear base colour
        alpha: opacity, the largest one of its picture included
        mode, cutoff: how opacity is used
        picture: codes (h, w, 3) of the base colour, not yet multiplied
        uv_set: number of the texture coordinates
        transform: (2, 3) of texture coordinates
    """

    material: Material
    factor: np.ndarray
    alpha: float
    mode: str
    cutoff: float
    picture: np.ndarray | None = None
    uv_set: int = 0
    transform: np.ndarray | None = None


def read_surfaces(source: MeshSource) -> Iterator[Surface]:
    """Triangles of the scene of a file for each primitive of its meshes, in metres as the format has them.

    Raises:
        MeshError: the file is not as expected, or needs an extension that is not read.
    """
    file = GltfFile(source)
    _check_extensions(file)
    looks: dict[Any, _Look] = {}
    shown, faces = set[int](), 0
    for number, node, transform in _placed_meshes(file):
        shown.add(number)
        mesh = file.entry("meshes", number)
        weights = node.get("weights", mesh.get("weights", []))
        for primitive in mesh["primitives"]:
            key = primitive.get("material")
            if key not in looks:
                looks[key] = _look(file, {} if key is None else file.entry("materials", key))
            for surface in _surfaces(file, primitive, looks[key], weights, transform):
                faces += len(surface.faces)
                if faces > FACE_LIMIT:
                    raise source.fault(f"more than {FACE_LIMIT} triangles", "at most so many")
                yield surface
    _name_what_is_not_used(file, shown)


def _check_extensions(file: GltfFile) -> None:
    required = file.json.get("extensionsRequired", [])
    lacking = sorted({str(extension) for extension in required} - _KNOWN_EXTENSIONS)
    if lacking:
        expected = f"none, or {', '.join(sorted(_KNOWN_EXTENSIONS))}"
        raise file.source.fault(f"required extensions {', '.join(lacking)[:200]}", expected)
    for each in file.extensions():
        if each not in _KNOWN_EXTENSIONS and not each.startswith("KHR_xmp"):
            file.source.notes.add("extensions of glTF, not used", each)


def _name_what_is_not_used(file: GltfFile, shown: set[int]) -> None:
    notes = file.source.notes
    parts = {
        "animations, of which the pose of the file is used": len(file.entries("animations")),
        "scenes beside the one that is read": len(file.entries("scenes")) - 1,
        "meshes that are not in the scene": len(file.entries("meshes")) - len(shown),
    }
    for kind, number in parts.items():
        if number > 0:
            notes.add(kind, "", number)


def _placed_meshes(file: GltfFile) -> Iterator[tuple[int, dict[str, Any], np.ndarray]]:
    """Number of every mesh of the scene, its node, and the transform (4, 4) from the mesh to the scene."""
    nodes = file.entries("nodes")
    scenes = file.entries("scenes")
    if scenes:
        roots = file.entry("scenes", file.json.get("scene", 0)).get("nodes", [])
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in children]
    left, seen = [(index, np.eye(4)) for index in reversed(roots)], set[int]()
    while left:
        index, above = left.pop()
        node = file.entry("nodes", index)
        if index in seen:
            raise file.source.fault(f"node {index} in two places", "a tree of nodes")
        seen.add(index)
        transform = above @ _transform(file, index, node)
        if "mesh" in node:
            if "skin" in node:
                file.source.notes.add("skins, without which meshes are drawn as they are modelled")
            yield node["mesh"], node, transform
        left += [(child, transform) for child in reversed(node.get("children", []))]


def _transform(file: GltfFile, index: int, node: dict[str, Any]) -> np.ndarray:
    """Transform (4, 4) of a node to the one above."""
    if "matrix" in node:
        beside = [name for name in ("translation", "rotation", "scale") if name in node]
        if beside:
            raise file.source.fault(f"node {index} with a matrix and {', '.join(beside)}", "one of both")
        matrix = np.array(node["matrix"], float).reshape(4, 4).T
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            found = f"node {index} with a matrix whose last row is {', '.join(f'{each:g}' for each in matrix[3])}"
            raise file.source.fault(found, "0, 0, 0, 1, of one that is written column by column")
        return matrix
    rotation = np.array(node.get("rotation", [0.0, 0.0, 0.0, 1.0]), float).reshape(4)
    length = float(np.linalg.norm(rotation))
    if not abs(length - 1.0) < _LONGEST_ROUNDING:
        raise file.source.fault(f"node {index} with a rotation of length {length:.3g}", "a unit quaternion")
    x, y, z, w = rotation / length
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    found = np.eye(4)
    found[:3, :3] = turn * np.array(node.get("scale", [1.0, 1.0, 1.0]), float).reshape(3)
    found[:3, 3] = np.array(node.get("translation", [0.0, 0.0, 0.0]), float).reshape(3)
    return found


def _surfaces(
    file: GltfFile, primitive: dict[str, Any], look: _Look, weights: list[float], transform: np.ndarray
) -> Iterator[Surface]:
    """Triangles of a primitive in the scene; none if it has points or lines."""
    source, attributes = file.source, primitive["attributes"]
    mode = primitive.get("mode", 4)
    if mode in (0, 1, 2, 3):
        source.notes.add("points and lines, not used")
        return
    for name in _COMPRESSED:
        if name in primitive.get("extensions", {}) and "bufferView" not in file.entry(
            "accessors", attributes["POSITION"]
        ):
            raise source.fault(f"a mesh compressed with {name}", "one that is not compressed")
    vertices = source.finite(_morphed(file, primitive, weights) @ transform[:3, :3].T + transform[:3, 3])
    faces = _faces(file, primitive, mode, len(vertices))
    if np.linalg.det(transform[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    uv = None
    if look.picture is not None:
        uv = _texture_places(file, attributes, look, len(vertices))
    tint = _vertex_colors(file, attributes, len(vertices))
    for name in attributes:
        # Pictures that other texture coordinates are for are noted themselves.
        if name not in _KNOWN_ATTRIBUTES and not name.startswith("TEXCOORD_"):
            source.notes.add("attributes of vertices, not used", name)
    alpha = np.full(len(faces), look.alpha)
    factors = None
    if tint is not None:
        of_faces = tint[faces].mean(axis=1)
        alpha, factors = alpha * of_faces[:, 3], of_faces[:, :3]
    alpha = _effective_alpha(look, alpha)
    if look.picture is None or uv is None:
        colors = None if factors is None else look.factor * factors
        yield Surface(vertices, faces, look.material, colors=colors, alpha=alpha)
        return
    mean = np.ones(3)
    if factors is not None and len(factors):
        mean = factors.mean(axis=0)
        if np.ptp(factors, axis=0).max() > _LEAST_SPREAD:
            source.notes.add("colours of vertices beside a picture, which is multiplied with their mean")
    texture = scaled_texture(look.picture, look.factor * mean)
    yield Surface(vertices, faces, dataclasses.replace(look.material, texture=texture), uv, None, alpha)


def _effective_alpha(look: _Look, alpha: np.ndarray) -> np.ndarray:
    """Opacity (m,) that the mode of the material gives."""
    if look.mode == "OPAQUE":
        return np.ones_like(alpha)
    return np.where(alpha >= look.cutoff, 1.0, 0.0) if look.mode == "MASK" else alpha


def _morphed(file: GltfFile, primitive: dict[str, Any], weights: list[float]) -> np.ndarray:
    """Vertices (n, 3) of a primitive with the morph targets that the file's weights give."""
    vertices = _checked(file, file.accessor(primitive["attributes"]["POSITION"]), 3)
    targets = primitive.get("targets", [])
    if targets and not any(weights):
        file.source.notes.add("morph targets, whose weights are 0", "", len(targets))
    for target, weight in zip(targets, weights, strict=False):
        if "POSITION" in target and weight:
            moved = _checked(file, file.accessor(target["POSITION"]), 3)
            vertices = vertices + float(weight) * moved
    return vertices


def _checked(file: GltfFile, values: np.ndarray, *widths: int) -> np.ndarray:
    if values.shape[1] not in widths:
        raise file.source.fault(f"vectors of {values.shape[1]} numbers", f"{' or '.join(map(str, widths))}")
    return values


def _faces(file: GltfFile, primitive: dict[str, Any], mode: Any, count: int) -> np.ndarray:
    """Triangles (m, 3) of a primitive: single ones, a strip or a fan."""
    if "indices" in primitive:
        order = _checked(file, file.accessor(primitive["indices"]), 1)[:, 0].astype(np.int64)
    else:
        order = np.arange(count)
    if not ((order >= 0).all() and (order < count).all()):
        raise file.source.fault("a face with a vertex that is not there", f"numbers up to {count - 1}")
    if mode == 4:
        if len(order) % 3:
            file.source.notes.add("corners after the last complete triangle, not used")
        return order[: len(order) - len(order) % 3].reshape(-1, 3)
    begin = np.arange(max(0, len(order) - 2))
    if mode == 5:
        odd = begin % 2
        return np.stack([order[begin], order[begin + 1 + odd], order[begin + 2 - odd]], axis=1)
    if mode == 6:
        return np.stack([order[begin + 1], order[begin + 2], np.full(len(begin), order[0])], axis=1)
    raise file.source.fault(f"a primitive of mode {mode!r:.20}", "0 to 6")


def _vertex_colors(file: GltfFile, attributes: dict[str, Any], count: int) -> np.ndarray | None:
    """Linear colours and opacity (n, 4) of vertices, with which those of the material are multiplied."""
    if "COLOR_0" not in attributes:
        return None
    colors = _checked(file, file.accessor(attributes["COLOR_0"]), 3, 4)
    entry = file.entry("accessors", attributes["COLOR_0"])
    if entry["componentType"] != 5126 and not entry.get("normalized"):
        # Integers that are colours cannot be meant as they are.
        file.source.notes.add("colours of vertices that are not marked as normalised, read as if they were")
        colors = colors / (255.0 if entry["componentType"] in (5120, 5121) else 65535.0)
    if len(colors) != count:
        raise file.source.fault(f"{len(colors)} colours of {count} vertices", "one for each")
    if (np.abs(file.source.finite(colors) - 0.5) > _LARGEST_COLOR - 0.5).any():
        file.source.notes.add(BEYOND, "COLOR_0")
    colors = np.clip(colors, 0.0, 1.0)
    return np.column_stack([colors, np.ones((count, 4 - colors.shape[1]))])


def _texture_places(file: GltfFile, attributes: dict[str, Any], look: _Look, count: int) -> np.ndarray | None:
    """Texture coordinates (n, 2), v upwards; None, with a note, if those of the picture are missing."""
    name = f"TEXCOORD_{look.uv_set}"
    if name not in attributes:
        file.source.notes.add("pictures without their texture coordinates, not used", name)
        return None
    uv = file.source.finite(_checked(file, file.accessor(attributes[name]), 2))
    if len(uv) != count:
        raise file.source.fault(f"{len(uv)} texture coordinates of {count} vertices", "one for each")
    if look.transform is not None:
        uv = uv @ look.transform[:, :2].T + look.transform[:, 2]
    return np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])


def _look(file: GltfFile, entry: dict[str, Any]) -> _Look:
    """A material; without an entry, or the part for metals and roughness, it has the defaults of the format."""
    notes = file.source.notes
    found = entry.get("pbrMetallicRoughness", {})
    factor = np.array(found.get("baseColorFactor", [1.0] * 4), float).reshape(4)
    metallic, roughness = float(found.get("metallicFactor", 1.0)), float(found.get("roughnessFactor", 1.0))
    if not np.isfinite([*factor, metallic, roughness]).all():
        raise file.source.fault("a factor of a material that is not finite", "0 to 1")
    for name, values in (("baseColorFactor", factor), ("metallicFactor", metallic), ("roughnessFactor", roughness)):
        if not ((np.asarray(values) >= 0.0) & (np.asarray(values) <= 1.0)).all():
            notes.add(BEYOND, name)
    factor = np.clip(factor, 0.0, 1.0)
    if "metallicRoughnessTexture" in found:
        picture = _texture_picture(file, found["metallicRoughnessTexture"])
        if picture is not None:
            mean = picture[..., :3].mean(axis=(0, 1)) / 255.0
            roughness, metallic = roughness * mean[1], metallic * mean[2]
            if np.ptp(picture[..., 1:3], axis=(0, 1)).max() > 255.0 * _LEAST_SPREAD:
                notes.add("pictures of metallicity and roughness, of which the mean is used")
    for key in ("normalTexture", "occlusionTexture", "emissiveTexture"):
        if key in entry:
            notes.add("properties of materials, not used", key)
    if any(entry.get("emissiveFactor", [])):
        notes.add("properties of materials, not used", "emissiveFactor")
    mode = entry.get("alphaMode", "OPAQUE")
    if mode not in ("OPAQUE", "MASK", "BLEND"):
        raise file.source.fault(f"alphaMode {mode!r:.20}", "OPAQUE, MASK or BLEND")
    red, green, blue = factor[:3]
    material = Material(
        (float(red), float(green), float(blue)),
        float(np.clip(metallic, 0.0, 1.0)),
        float(np.clip(roughness, _MIN_ROUGHNESS, 1.0)),
    )
    plain = _Look(material, factor[:3], float(factor[3]), mode, float(entry.get("alphaCutoff", 0.5)))
    return _with_base_color(file, plain, found["baseColorTexture"]) if "baseColorTexture" in found else plain


def _with_base_color(file: GltfFile, look: _Look, texture: dict[str, Any]) -> _Look:
    """The material with the picture of its base colour."""
    picture = _texture_picture(file, texture)
    if picture is None:
        return look
    opacity = picture[..., 3]
    if look.mode != "OPAQUE" and opacity.min() < 255 and opacity.max() > 0:
        file.source.notes.add("transparent parts of pictures, drawn opaque")
    alpha = look.alpha * float(opacity.max()) / 255.0
    extension = texture.get("extensions", {}).get("KHR_texture_transform", {})
    uv_set = extension.get("texCoord", texture.get("texCoord", 0))
    found = dataclasses.replace(look, picture=picture[..., :3], alpha=alpha, uv_set=uv_set)
    if not extension:
        return found
    if extension.get("rotation", 0.0) != 0.0:  # the sign differs between readers
        raise file.source.fault(
            "a picture that is turned by KHR_texture_transform", "one that is scaled and moved alone"
        )
    scale = np.array(extension.get("scale", [1.0, 1.0]), float).reshape(2)
    offset = np.array(extension.get("offset", [0.0, 0.0]), float).reshape(2)
    return dataclasses.replace(found, transform=np.column_stack([np.diag(scale), offset]))


def _texture_picture(file: GltfFile, texture: dict[str, Any]) -> np.ndarray | None:
    """Codes and opacity (h, w, 4) of the picture of a texture."""
    entry = file.entry("textures", texture["index"])
    webp = entry.get("extensions", {}).get("EXT_texture_webp", {}).get("source")
    image = entry.get("source") if webp is None else webp
    if image is None:
        file.source.notes.add("pictures in a format that is not read, without which surfaces have one colour")
        return None
    if "sampler" in entry:
        sampler = file.entry("samplers", entry["sampler"])
        if {sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)} != {_REPEAT}:
            file.source.notes.add("pictures that do not repeat beyond their rims, drawn as if they did")
    return file.picture(image)
