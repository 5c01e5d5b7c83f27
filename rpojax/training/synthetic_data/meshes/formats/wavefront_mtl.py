"""Material libraries of OBJ files."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.mesh_source import (
    BEYOND,
    MeshNotes,
    MeshSource,
    linear_colors,
    name_in,
    scaled_texture,
)
from rpojax.training.synthetic_data.meshes.target_mesh import Material

_MIN_ROUGHNESS = 0.2
_HARMLESS = frozenset({"ka", "ks", "ni", "illum", "ns", "pr", "pm", "kd", "d", "tr", "map_kd", "newmtl"})
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
    """Materials of a library by name, None if it is not there.

    Raises:
        MeshError: it cannot be read.
    """
    text = source.text_of(name)
    if text is None:
        return None
    materials: dict[str, dict[str, str]] = {}
    entries: dict[str, str] | None = None
    for line in _joined(text).split("\n"):
        key, _, value = line.strip().replace("\t", " ").partition(" ")
        key = key.lower()
        value = name_in(value) if key == "newmtl" or key.startswith("map_") else value.partition("#")[0].strip()
        if key == "newmtl":
            if value in materials:
                source.notes.add("materials with the name of another one, not used", repr(value))
            entries = materials.setdefault(value, {}) if value not in materials else {}
        elif key and key[0] != "#" and entries is not None:
            entries[key] = value
    return {each: _material(source, name, each, found) for each, found in materials.items()}


def _joined(text: str) -> str:
    """The text with continued lines in one; a name may end in a backslash only where nothing follows."""
    return text.replace("\\\n", " ")


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
        if key in _HARMLESS or (key in _NEUTRAL and _is_neutral(entries[key], _NEUTRAL[key])):
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
