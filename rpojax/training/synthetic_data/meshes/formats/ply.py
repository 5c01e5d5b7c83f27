"""Meshes in PLY: faces of any number of corners, with colours of vertices or faces, or a picture."""

import dataclasses
import re
from collections.abc import Iterator

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.ear_clipping import Triangles
from rpojax.training.synthetic_data.meshes.formats.mesh_source import MeshSource, Surface, linear_colors
from rpojax.training.synthetic_data.meshes.formats.ply_elements import Element, Lists, read_elements, read_header
from rpojax.training.synthetic_data.meshes.target_mesh import Material

_INDICES = ("vertex_indices", "vertex_index")
_COLORS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_ALPHA = ("alpha", "a", "diffuse_alpha")
_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_HARMLESS = frozenset({"nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "flags"})
"""Properties that change no flat-shaded triangle."""
_FULL_SCALE = {"u1": 255.0, "u2": 65535.0}


def read_surfaces(source: MeshSource) -> Iterator[Surface]:
    """Triangles of a file for each of its pictures.

    Raises:
        MeshError: the file is not as expected.
    """
    header = read_header(source)
    if "tristrips" in header.elements:
        raise source.fault("strips of triangles ('tristrips')", "faces")
    elements = read_elements(source, header)
    for name, element in elements.items():
        if name not in ("vertex", "face") and element.count:
            source.notes.add("elements that are not read", f"{name} ({element.count} rows)")
    if "vertex" not in elements or "face" not in elements or not elements["face"].count:
        return
    vertex, face = elements["vertex"], elements["face"]
    if not {"x", "y", "z"} <= set(vertex.columns):
        raise source.fault("vertices without x, y or z", "three coordinates")
    vertices = source.finite(np.stack([vertex.columns[axis] for axis in "xyz"], axis=1))
    corners, sizes = _corners(source, face, vertex.count)
    triangles = source.triangles(vertices[corners], sizes)
    yield from _Appearance(source, vertex, face, header.comments).surfaces(vertices, corners, sizes, triangles)


def _corners(source: MeshSource, face: Element, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of the corners of all faces, and the number of corners of each face."""
    name = next((kind for kind in _INDICES if kind in face.lists), None)
    if name is None:
        raise source.fault(f"faces with {', '.join(face.properties)!r:.80}", "their vertices as vertex_indices")
    found = face.lists[name]
    if not ((found.values >= 0).all() and (found.values < count).all() and (found.values % 1 == 0).all()):
        raise source.fault("a face with a vertex that is not there", f"numbers from 0 to {count - 1}")
    return found.values.astype(np.int64), found.sizes.astype(np.int64)


class _Appearance:
    """Colours, opacity and pictures of a file; what it has beside them is noted."""

    def __init__(self, source: MeshSource, vertex: Element, face: Element, comments: list[str]) -> None:
        self._source, self._vertex, self._face = source, vertex, face
        named = [re.fullmatch(r"texturefile\s+(.+)", comment, re.IGNORECASE) for comment in comments]
        self._pictures = [match[1].strip() for match in named if match]
        self._used = {*_INDICES, "x", "y", "z"}

    def surfaces(
        self, vertices: np.ndarray, corners: np.ndarray, sizes: np.ndarray, triangles: Triangles
    ) -> Iterator[Surface]:
        """The triangles, with the colours of their faces or else of their vertices, apart for each picture."""
        faces = corners[triangles.corners]
        colors = self._colors(faces, triangles.polygons)
        uv = self._uv(corners, sizes)
        number = self._picture_numbers()[triangles.polygons]
        self._name_what_is_not_used()
        plain = Surface(vertices, faces, colors=colors)
        done = np.zeros(len(faces), bool)
        if self._pictures and uv is None:
            self._source.notes.add("pictures without texture coordinates, not used", "", len(self._pictures))
        for index, name in enumerate(self._pictures if uv is not None else ()):
            chosen = number == index
            picture = self._source.picture(name) if chosen.any() else None
            if picture is None or uv is None:
                continue
            if picture[..., 3].min() < 255:
                self._source.notes.add("transparent parts of pictures, drawn opaque", repr(name))
            if colors is not None:
                self._source.notes.add("colours beside a picture, which counts alone, not used")
            places = triangles.corners[chosen]
            # Every corner has a vertex of its own, since texture coordinates are those of corners.
            own = np.arange(places.size).reshape(-1, 3)
            material = Material(texture=picture[..., :3])
            yield Surface(vertices[faces[chosen]].reshape(-1, 3), own, material, uv[places].reshape(-1, 2))
            done |= chosen
        if not done.all():
            rest = None if colors is None else colors[~done]
            yield dataclasses.replace(plain, faces=faces[~done], colors=rest)

    def _colors(self, faces: np.ndarray, polygons: np.ndarray) -> np.ndarray | None:
        """Linear colours (m, 3) of triangles, None if the file has none."""
        of_faces, of_vertices = self._codes(self._face), self._codes(self._vertex)
        if of_faces is not None and of_vertices is not None:
            self._source.notes.add("colours of vertices beside those of faces, which count alone, not used")
        if of_faces is not None:
            return linear_colors(of_faces[polygons])
        return None if of_vertices is None else linear_colors(of_vertices[faces].mean(axis=1))

    def _codes(self, element: Element) -> np.ndarray | None:
        """sRGB codes (n, 3) in 0..1 of the rows of an element."""
        names = next((color for color in _COLORS if set(color) <= set(element.columns)), None)
        if names is None or not element.count:
            return None
        self._used |= set(names)
        for name in _ALPHA:
            if name in element.columns:
                self._used.add(name)
                # Programs write 0 as well as 255 where they mean nothing by it.
                if (element.columns[name] < _full_scale(element, name)).any():
                    self._source.notes.add("opacity of vertices or faces, drawn opaque", name)
        codes = self._source.finite(np.stack([element.columns[name] for name in names], axis=1))
        if _full_scale(element, names[0]) > 1.0 and codes.max() == 1.0:
            self._source.notes.add("colours of 0 and 1 in whole numbers, read as codes, almost black", ", ".join(names))
        return np.clip(codes / max(_full_scale(element, name) for name in names), 0.0, 1.0)

    def _uv(self, corners: np.ndarray, sizes: np.ndarray) -> np.ndarray | None:
        """Texture coordinates (c, 2) of all corners."""
        if not self._pictures:
            return None
        found = self._face.lists.get("texcoord")
        if isinstance(found, Lists) and (found.sizes == 2 * sizes).all():
            self._used.add("texcoord")
            return self._source.finite(found.values.reshape(-1, 2))
        for pair in _UV:
            if set(pair) <= set(self._vertex.columns):
                self._used |= set(pair)
                return self._source.finite(np.stack([self._vertex.columns[name] for name in pair], axis=1))[corners]
        return None

    def _picture_numbers(self) -> np.ndarray:
        """Number of the picture (p,) of every face; the first one where the file does not say."""
        if len(self._pictures) < 2 or "texnumber" not in self._face.columns:
            if len(self._pictures) > 1:
                self._source.notes.add("pictures after the first one, not used", "", len(self._pictures) - 1)
            self._used.add("texnumber")
            return np.zeros(self._face.count, np.int64)
        self._used.add("texnumber")
        return self._face.columns["texnumber"].astype(np.int64)

    def _name_what_is_not_used(self) -> None:
        for what, element in (("vertices", self._vertex), ("faces", self._face)):
            for name in element.properties:
                if name not in self._used and name not in _HARMLESS:
                    self._source.notes.add(f"properties of {what}, not used", name)


def _full_scale(element: Element, name: str) -> float:
    """Value of a full colour: the largest one of small integers, 1 of fractions, otherwise 255."""
    kind = element.properties[name].kind
    is_fraction = kind[0] == "f" and element.columns[name].max() <= 1.0
    return _FULL_SCALE.get(kind, 1.0 if is_fraction else 255.0)
