"""Meshes in Wavefront's OBJ, with the materials of their libraries."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.mesh_source import (
    BEYOND,
    MeshNotes,
    MeshSource,
    Surface,
    linear_colors,
    name_in,
    scaled_texture,
)
from rpojax.training.synthetic_data.meshes.target_mesh import Material

_MIN_ROUGHNESS = 0.2
_HARMLESS_OF_MATERIALS = frozenset({"ka", "ks", "ni", "illum", "ns", "pr", "pm", "kd", "d", "tr", "map_kd", "newmtl"})
"""Keywords that are used, or that are about light which the ray tracer has of its own."""
_NEUTRAL = {"ke": 0.0, "tf": 1.0, "ps": 0.0, "pc": 0.0, "pcr": 0.0, "aniso": 0.0, "anisor": 0.0}
"""Keywords that are not used, with the value at which that makes no difference."""
_VALUES_OF_OPTIONS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-bm": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-o": 3,
    "-s": 3,
    "-t": 3,
    "-texres": 1,
    "-type": 1,
}
"""Most values of each option of a picture; those of three may have fewer numbers."""
_HARMLESS_OPTIONS = frozenset({"-blendu", "-blendv", "-bm"})
"""Options about bumps and how far colours blend at the rim of a picture."""
_HARMLESS = frozenset({"vn", "vp", "g", "o", "s", "mg", "bevel", "c_interp", "d_interp", "lod"})
"""Statements that change no flat-shaded triangle; `vp` alone is no surface."""
_CODES = 255.0


@dataclasses.dataclass(frozen=True)
class ObjMaterial:
    """A material of a library.

    Attributes:
        material: colour, reflection and texture
        alpha: opacity 0..1
        scale, offset: (2,) of texture coordinates: scale * uv + offset
    """

    material: Material = dataclasses.field(default_factory=Material)
    alpha: float = 1.0
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def read_library(source: MeshSource, name: str) -> dict[str, ObjMaterial] | None:
    """Materials of a library by name, None if the file is missing.

    Raises:
        MeshError: it cannot be read.
    """
    text = source.text_of(name)
    if text is None:
        return None
    materials: dict[str, dict[str, str]] = {}
    entries: dict[str, str] | None = None
    # A backslash at the end continues a line; a name may end in one only where nothing follows.
    for line in text.replace("\\\n", " ").split("\n"):
        key, _, value = line.strip().replace("\t", " ").partition(" ")
        key = key.lower()
        value = name_in(value) if key == "newmtl" or key.startswith("map_") else value.partition("#")[0].strip()
        if key == "newmtl":
            if value in materials:
                source.notes.add("materials with the name of another one, not used", repr(value))
            entries = materials.setdefault(value, {}) if value not in materials else {}
        elif key and key[0] != "#" and entries is not None:
            entries[key] = value
    return {material: _material(source, name, material, found) for material, found in materials.items()}


def _material(source: MeshSource, library: str, name: str, entries: Mapping[str, str]) -> ObjMaterial:
    place = f"{library!r}, material {name!r}"

    def numbers(key: str) -> list[float]:
        try:
            found = [float(word) for word in entries[key].split() if not word.startswith("-h")]
            if not found or not np.isfinite(found).all():
                raise ValueError
            return found
        except ValueError:
            raise source.fault(f"{key} {entries[key]!r:.60} in {place}", "numbers") from None

    _name_what_is_not_used(source.notes, entries, numbers)
    color = _color(source, place, entries, numbers)
    codes = np.array([Material().color[0] ** (1.0 / 2.2)] * 3) if color is None else color
    shininess = max(0.0, numbers("ns")[0]) if "ns" in entries else 1.0
    roughness = numbers("pr")[0] if "pr" in entries else (2.0 / (shininess + 2.0)) ** 0.25
    metallic = numbers("pm")[0] if "pm" in entries else 0.0
    red, green, blue = linear_colors(codes)
    material = Material(
        (float(red), float(green), float(blue)),
        float(np.clip(metallic, 0.0, 1.0)),
        float(np.clip(roughness, _MIN_ROUGHNESS, 1.0)),
    )
    # `d` is opacity in the format itself, `Tr` is one minus it in that of later programs.
    alpha = numbers("d")[0] if "d" in entries else 1.0 - numbers("tr")[0] if "tr" in entries else 1.0
    found = ObjMaterial(material, float(np.clip(alpha, 0.0, 1.0)))
    return _with_picture(source, found, entries["map_kd"], color) if "map_kd" in entries else found


def _color(
    source: MeshSource, place: str, entries: Mapping[str, str], numbers: Callable[[str], list[float]]
) -> np.ndarray | None:
    """Codes (3,) of `Kd`; the second and third are those of the first if they are missing."""
    if "kd" not in entries:
        return None
    if entries["kd"].split()[:1] in (["spectral"], ["xyz"]):
        raise source.fault(f"Kd {entries['kd']!r:.60} in {place}", "red, green and blue")
    found = numbers("kd")
    if len(found) not in (1, 3):
        raise source.fault(f"Kd {entries['kd']!r:.60} in {place}", "red, green and blue")
    if not 0.0 <= min(found) <= max(found) <= 1.0:
        source.notes.add(BEYOND, f"Kd {entries['kd']}")
    return np.clip(np.resize(np.array(found), 3), 0.0, 1.0)


def _name_what_is_not_used(notes: MeshNotes, entries: Mapping[str, str], numbers: Callable[[str], list[float]]) -> None:
    for key in entries:
        if key in _HARMLESS_OF_MATERIALS or (key in _NEUTRAL and _is_neutral(entries[key], _NEUTRAL[key])):
            continue
        notes.add("properties of materials, not used", key)


def _is_neutral(value: str, neutral: float) -> bool:
    try:
        return all(float(word) == neutral for word in value.split())
    except ValueError:
        return False


def _with_picture(source: MeshSource, found: ObjMaterial, value: str, color: np.ndarray | None) -> ObjMaterial:
    """The material with the picture of `map_Kd`, whose codes are multiplied with those of `Kd`."""
    name, options = _name_and_options(source, value)
    picture = source.picture(name)
    if picture is None:
        return found
    if picture[..., 3].min() < 255:
        source.notes.add("transparent parts of pictures, drawn opaque", repr(name))
    if color is not None and not color.any():
        source.notes.add("black Kd beside map_Kd, of which the picture alone is used", repr(name))
        color = None
    texture = picture[..., :3] if color is None else scaled_texture(picture, linear_colors(color))
    scale, offset = (_two(source, value, options.get(key), default) for key, default in (("-s", 1.0), ("-o", 0.0)))
    return dataclasses.replace(
        found, material=dataclasses.replace(found.material, texture=texture), scale=scale, offset=offset
    )


def _two(source: MeshSource, value: str, words: Sequence[str] | None, default: float) -> tuple[float, float]:
    found = [float(word) for word in words or ()]
    if not np.isfinite(found).all():
        raise source.fault(f"map_Kd {value!r:.80}", "finite numbers after its options")
    first, second = [*found, default, default][:2]
    return first, second


def _name_and_options(source: MeshSource, value: str) -> tuple[str, dict[str, list[str]]]:
    """Name of a picture, which may have spaces, and the values of the options before it."""
    options: dict[str, list[str]] = {}
    rest = value
    while rest.startswith("-"):
        key, _, after = rest.partition(" ")
        most = _VALUES_OF_OPTIONS.get(key.lower())
        if most is None:
            break
        rest, values = after.strip(), list[str]()
        while len(values) < most:
            word, _, after = rest.partition(" ")
            # A picture may have a number as its name: the last word is never a value.
            if not after.strip() or (values and most == 3 and not _is_number(word)):
                break
            values.append(word)
            rest = after.strip()
        options[key.lower()] = values
        is_default = key.lower() in ("-s", "-o", "-t") and _is_neutral(" ".join(values), float(key.lower() == "-s"))
        if key.lower() in ("-s", "-o") and not is_default:
            source.notes.add("pictures that are scaled or moved, as scale * uv + offset", f"{key} {' '.join(values)}")
        elif key.lower() not in _HARMLESS_OPTIONS and not is_default:
            source.notes.add("options of pictures, not used", f"{key} {' '.join(values)}")
    return rest.strip('"'), options


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


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
    """Triangles (m, 3, 2) of a material; if it has a texture, triangles with texture coordinates come apart."""
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
