"""Meshes in Wavefront's OBJ, with the materials of their libraries."""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.mesh_source import (
    BEYOND,
    MeshSource,
    Surface,
    linear_colors,
    name_in,
)
from rpojax.training.synthetic_data.meshes.formats.wavefront_mtl import ObjMaterial, read_library

_HARMLESS = frozenset({"vn", "vp", "g", "o", "s", "mg", "bevel", "c_interp", "d_interp", "lod"})
"""Statements that change no flat-shaded triangle; `vp` alone is no surface."""
_CODES = 255.0


@dataclasses.dataclass
class _Content:
    """What the statements of a file give; faces have the number of their material and their corners."""

    vertices: list[list[float]] = dataclasses.field(default_factory=list)
    colors: dict[int, list[float]] = dataclasses.field(default_factory=dict)
    uv: list[list[float]] = dataclasses.field(default_factory=list)
    sizes: list[int] = dataclasses.field(default_factory=list)
    corners: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    owners: list[int] = dataclasses.field(default_factory=list)
    materials: dict[str, int] = dataclasses.field(default_factory=lambda: {"": 0})
    libraries: list[str] = dataclasses.field(default_factory=list)
    in_use: int = 0


def read_surfaces(source: MeshSource) -> Iterator[Surface]:
    """Triangles of a file for each of its materials.

    Raises:
        MeshError: the file is not as expected.
    """
    content = _parse(source)
    if not content.sizes:
        return
    vertices = source.finite(np.array(content.vertices, float).reshape(-1, 3))
    texture_places = source.finite(np.array(content.uv, float).reshape(-1, 2))
    corners = np.array(content.corners, np.int64).reshape(-1, 2)
    _check_corners(source, corners, len(vertices), len(texture_places))
    triangles = source.triangles(vertices[corners[:, 0]], np.array(content.sizes))
    materials = _materials(source, content)
    owner, colors = np.array(content.owners)[triangles.polygons], _vertex_colors(source, content)
    for name, number in content.materials.items():
        chosen = corners[triangles.corners[owner == number]]
        if not len(chosen):
            continue
        found = materials.get(name)
        if name and found is None:
            source.notes.add("materials in no library that was found, grey", repr(name))
        yield from _surfaces(source, found, chosen, vertices, texture_places, colors)


def _parse(source: MeshSource) -> _Content:
    content = _Content()
    statements: dict[str, Callable[[str, list[str]], None]] = {
        "v": lambda _, words: _add_vertex(source, content, words),
        "vt": lambda _, words: content.uv.append([float(word) for word in [*words, "0"][:2]]),
        "f": lambda _, words: _add_face(content, words),
        "fo": lambda _, words: _add_face(content, words),
        "usemtl": lambda rest, _: _use_material(content, rest),
        "mtllib": lambda rest, _: content.libraries.append(rest),
    }
    for number, line in enumerate(source.text().replace("\\\n", " ").split("\n"), start=1):
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        if not key or key.startswith("#"):
            continue
        if key not in statements:
            if key not in _HARMLESS:
                source.notes.add("statements that are not read", key)
            continue
        try:
            rest = rest.strip()
            if key in ("usemtl", "mtllib"):
                statements[key](name_in(rest), [])
            elif "_" in rest:  # Python would read 1_0 as ten
                raise ValueError
            else:
                statements[key](rest, rest.split("#")[0].split())
        except (ValueError, IndexError):
            raise source.fault(f"{line.strip()!r:.80} in line {number}", "a mesh in OBJ") from None
    return content


def _add_vertex(source: MeshSource, content: _Content, words: list[str]) -> None:
    values = [float(word) for word in words]
    if not 3 <= len(values) <= 8:
        raise ValueError
    if len(values) in (6, 7):
        content.colors[len(content.vertices)] = values[3:6]
    elif len(values) == 8:
        content.colors[len(content.vertices)] = values[4:7]
    if len(values) in (4, 8) and values[3] != 1.0:
        source.notes.add("weights of vertices, which faces do not have, not used")
    if len(values) == 5:
        source.notes.add("further numbers of vertices, not used")
    content.vertices.append(values[:3])


def _add_face(content: _Content, words: list[str]) -> None:
    for word in words:
        fields = word.split("/")
        if len(fields) > 3:
            raise ValueError
        place = _index(fields[0], len(content.vertices))
        texture = _index(fields[1], len(content.uv)) if len(fields) > 1 and fields[1] else -1
        content.corners.append((place, texture))
    content.sizes.append(len(words))
    content.owners.append(content.in_use)


def _index(word: str, count: int) -> int:
    """Place in a list of `count` values until now; negative numbers count from its present end."""
    number = int(word)
    if number == 0 or number < -count:
        raise IndexError
    return number - 1 if number > 0 else count + number


def _use_material(content: _Content, name: str) -> None:
    content.in_use = content.materials.setdefault(name, len(content.materials))


def _check_corners(source: MeshSource, corners: np.ndarray, vertices: int, texture_places: int) -> None:
    for what, highest, count in (
        ("vertex", corners[:, 0].max(initial=-1), vertices),
        ("texture coordinate", corners[:, 1].max(initial=-1), texture_places),
    ):
        if highest >= count:
            raise source.fault(f"a face with {what} {highest + 1}", f"numbers up to {count}")


def _materials(source: MeshSource, content: _Content) -> dict[str, ObjMaterial]:
    found: dict[str, ObjMaterial] = {}
    for line in dict.fromkeys(content.libraries):
        # A line names one library, whose name may have spaces, or several.
        names = [line] if source.find(line) is not None or " " not in line else line.split()
        for name in names:
            found = {**(read_library(source, name) or {}), **found}
    return found


def _vertex_colors(source: MeshSource, content: _Content) -> np.ndarray | None:
    """sRGB codes (n, 3) in 0..1 of all vertices, None if there are none."""
    if not content.colors:
        return None
    if len(content.colors) < len(content.vertices):
        source.notes.add("colours of some vertices alone, not used", "", len(content.colors))
        return None
    colors = source.finite(np.array([content.colors[index] for index in range(len(content.vertices))]))
    if colors.min() < 0.0:
        source.notes.add(BEYOND, "v")
    return np.clip(colors / (_CODES if colors.max() > 1.0 else 1.0), 0.0, 1.0)


def _surfaces(
    source: MeshSource,
    found: ObjMaterial | None,
    chosen: np.ndarray,
    vertices: np.ndarray,
    texture_places: np.ndarray,
    colors: np.ndarray | None,
) -> Iterator[Surface]:
    """Triangles (m, 3, 2) of one material, those with texture coordinates apart if it has a texture."""
    if found is None:
        own = None if colors is None else linear_colors(colors[chosen[..., 0]].mean(axis=1))
        yield Surface(vertices, chosen[..., 0], colors=own)
        return
    if colors is not None:
        source.notes.add("colours of vertices beside a material, which counts alone, not used")
    plain = dataclasses.replace(found.material, texture=None)
    has_uv = (chosen[..., 1] >= 0).all(axis=1) & (found.material.texture is not None)
    if found.material.texture is not None and not has_uv.all():
        source.notes.add(
            "faces with a picture but without texture coordinates, of one colour", "", int((~has_uv).sum())
        )
    for part, material in ((chosen[~has_uv], plain), (chosen[has_uv], found.material)):
        if not len(part):
            continue
        alpha = np.full(len(part), found.alpha)
        if material.texture is None:
            yield Surface(vertices, part[..., 0], material, alpha=alpha)
            continue
        pairs, faces = np.unique(part.reshape(-1, 2), axis=0, return_inverse=True)
        uv = texture_places[pairs[:, 1]] * found.scale + found.offset
        yield Surface(vertices[pairs[:, 0]], faces.reshape(-1, 3), material, uv, alpha=alpha)
