"""Meshes in STL, in text and binary: triangles without colours."""

from collections.abc import Iterator

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.mesh_source import MeshSource, Surface
from rpojax.untrusted.text_reading import EncodingError, decode_text

_HEADER = 84
_SHOWN = 16
_MOST_MISSING = 100.0
"""A file that says that it has so much more than it has is not cut off, but of another kind."""
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_surfaces(source: MeshSource) -> Iterator[Surface]:
    """The triangles of a file.

    Raises:
        MeshError: the file is not as expected.
    """
    corners = _binary(source) if _is_binary(source.content) else _text(source)
    corners = source.finite(corners.astype(np.float64))
    yield Surface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _is_binary(content: bytes) -> bool:
    """Whether the number of facets fits the size, or there are bytes that no text has; headers may begin like texts."""
    count = int.from_bytes(content[80:_HEADER], "little")
    is_text = content.lstrip()[:5].lower() == b"solid" and b"\0" not in content
    return len(content) == _HEADER + count * _FACET.itemsize or not is_text


def _binary(source: MeshSource) -> np.ndarray:
    content = source.content
    count = int.from_bytes(content[80:_HEADER], "little")
    if len(content) != _HEADER and (count == 0 or count * _FACET.itemsize > _MOST_MISSING * len(content)):
        raise source.fault(_what_it_is(content), "a mesh in STL")
    if len(content) < _HEADER + count * _FACET.itemsize:
        size = f"{len(content)} bytes"
        raise source.fault(size, f"a mesh in STL, of which one of {count} facets has more")
    if len(content) > _HEADER + count * _FACET.itemsize:
        more = (len(content) - _HEADER) // _FACET.itemsize - count
        room = f", with room for {more} facets that the header does not count" if more else ""
        source.notes.add(f"bytes after the last facet{room}, not used")
    facets = np.frombuffer(content, _FACET, count, _HEADER)
    colored = int(np.count_nonzero(facets["attribute"]))
    if colored or b"COLOR=" in content[:80]:
        source.notes.add("colours of facets, which programs write in different ways, not used", "", max(1, colored))
    return facets["corners"]


def _what_it_is(content: bytes) -> str:
    """What a file that is no mesh is: text of a wide encoding, or its first bytes."""
    try:
        decode_text(content)
    except EncodingError as error:
        if "UTF" in error.found.partition("(")[2]:
            return error.found
    return f"{content[:_SHOWN]!r} at its beginning"


def _text(source: MeshSource) -> np.ndarray:
    corners: list[list[float]] = []
    in_facet = 0
    for number, line in enumerate(source.text().split("\n"), start=1):
        words = line.split()
        match words[0].lower() if words else "":
            case "vertex":
                corners.append([float(word) for word in words[1:4]])
                if len(words) != 4:
                    raise source.fault(f"{line.strip()!r:.60} in line {number}", "three coordinates of a vertex")
                in_facet += 1
            case "endfacet":
                if in_facet != 3:
                    raise source.fault(f"a facet of {in_facet} corners before line {number}", "triangles")
                in_facet = 0
            case "" | "solid" | "endsolid" | "facet" | "outer" | "endloop":
                pass
            case other:
                raise source.fault(f"{other!r:.60} in line {number}", "a mesh in STL")
    if in_facet:
        raise source.fault("a last facet without its end", "a complete mesh in STL")
    return np.array(corners, float).reshape(-1, 3, 3)
