"""Containers of glTF: its JSON, and the numbers and pictures of its buffers.

Source: Khronos Group, glTF 2.0 Specification, sections 3.6 and 4.4.
"""

import base64
import binascii
import urllib.parse
from collections.abc import Iterator
from typing import Any

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.mesh_source import FACE_LIMIT, MeshSource
from rpojax.untrusted.file_reading import FileKind
from rpojax.untrusted.json_reading import parse_json
from rpojax.untrusted.structure_limits import StructureError

_MAGIC = b"glTF"
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_LARGEST = {"<i1": 127.0, "<u1": 255.0, "<i2": 32767.0, "<u2": 65535.0}
_MOST_ROWS = 3 * FACE_LIMIT + 3


class GltfFile:
    """JSON of a glTF file, and what its accessors and images refer to.

    Raises:
        MeshError: it is no glTF of version 2.
    """

    def __init__(self, source: MeshSource) -> None:
        self.source = source
        text, self._binary = _chunks(source)
        try:
            self.json = parse_json(text)
        except StructureError as error:
            raise source.fault(f"JSON that cannot be read ({error})", "that of glTF") from None
        if not isinstance(self.json, dict):
            raise source.fault("JSON without keys", "that of glTF")
        asset = self.json.get("asset", {})
        version = str(asset.get("minVersion", asset.get("version")))
        if version.partition(".")[0] != "2" or ("minVersion" in asset and version != "2.0"):
            raise source.fault(f"glTF of version {version!r:.20}", "2.0")
        self._buffers: dict[int, bytes] = {}

    def entries(self, key: str) -> list[dict[str, Any]]:
        """List of the JSON by its key, empty if there is none."""
        found = self.json.get(key, [])
        if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
            raise self.source.fault(f"no list of {key}", "one, as in glTF")
        return found

    def entry(self, key: str, index: Any) -> dict[str, Any]:
        """An entry of a list of the JSON.

        Raises:
            MeshError: it is not there.
        """
        found = self.entries(key)
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(found):
            raise self.source.fault(f"{key} {index!r:.40}", f"one of {len(found)}")
        return found[index]

    def accessor(self, index: Any) -> np.ndarray:
        """Numbers (n, width) of an accessor as float64; codes of normalised integers become 0..1 or -1..1."""
        entry = self.entry("accessors", index)
        kind, width, count = _COMPONENTS.get(entry["componentType"]), _WIDTHS.get(entry["type"]), entry["count"]
        if kind is None or width is None or not isinstance(count, int) or not 0 < count <= _MOST_ROWS:
            found = (
                f"accessor {index} of {entry['type']!r:.20}, type {entry['componentType']!r:.20}, {count!r:.20} rows"
            )
            raise self.source.fault(found, "vectors of numbers as in glTF")
        values = np.zeros((count, width), kind)
        if "bufferView" in entry:
            values = self._rows(entry["bufferView"], entry.get("byteOffset", 0), kind, width, count)
        if "sparse" in entry:
            values = self._with_sparse(values, entry["sparse"], kind, width)
        found = values.astype(np.float64)
        if entry.get("normalized"):
            if kind not in _LARGEST:
                raise self.source.fault(f"accessor {index} of normalised {kind[1:]}", "8 or 16 bit")
            found = np.maximum(found / _LARGEST[kind], -1.0)
        return found

    def _with_sparse(self, values: np.ndarray, sparse: dict[str, Any], kind: str, width: int) -> np.ndarray:
        """Rows of an accessor, some of which are replaced."""
        count, where, what = sparse["count"], sparse["indices"], sparse["values"]
        if not isinstance(count, int) or not 0 < count <= len(values):
            raise self.source.fault(f"{count!r:.20} replaced rows", f"1 to {len(values)}")
        form = _COMPONENTS[where["componentType"]]
        rows = self._rows(where["bufferView"], where.get("byteOffset", 0), form, 1, count)[:, 0].astype(np.int64)
        if not ((rows >= 0).all() and (rows < len(values)).all()):
            raise self.source.fault("a replaced row that is not there", f"rows up to {len(values) - 1}")
        changed = values.copy()
        changed[rows] = self._rows(what["bufferView"], what.get("byteOffset", 0), kind, width, count)
        return changed

    def _rows(self, view: Any, offset: Any, kind: str, width: int, count: int) -> np.ndarray:
        content, stride = self.view(view)
        form = np.dtype(kind)
        row = width * form.itemsize
        stride = row if stride is None else stride
        fits = isinstance(offset, int) and offset >= 0 and offset + stride * (count - 1) + row <= len(content)
        if not fits or stride < row:
            raise self.source.fault(f"{count} rows from byte {offset!r:.20} on of {len(content)} bytes", "them inside")
        return np.ndarray((count, width), form, content, offset, (stride, form.itemsize))

    def view(self, index: Any) -> tuple[bytes, int | None]:
        """Bytes of a buffer view, and the distance of its rows if it gives one."""
        entry = self.entry("bufferViews", index)
        start, size, stride = entry.get("byteOffset", 0), entry["byteLength"], entry.get("byteStride")
        buffer = self._buffer(entry["buffer"])
        numbers = all(isinstance(each, int) and each >= 0 for each in (start, size, 0 if stride is None else stride))
        if not numbers or start + size > len(buffer):
            found = f"bytes {start!r:.20} to {start!r:.20} + {size!r:.20} of a buffer of {len(buffer)}"
            raise self.source.fault(found, "a part of it")
        return buffer[start : start + size], stride

    def _buffer(self, index: Any) -> bytes:
        if not isinstance(index, int) or index not in self._buffers:
            entry = self.entry("buffers", index)
            content = self._binary if "uri" not in entry else self.content_of(entry["uri"], FileKind.MESH)
            if content is None:
                what = f"{entry['uri']!r:.80}" if "uri" in entry else "its own part"
                raise self.source.fault(f"no buffer {what} beside it", "the file that glTF names")
            if len(content) < entry["byteLength"]:
                raise self.source.fault(f"a buffer of {len(content)} bytes", f"{entry['byteLength']!r:.20}")
            self._buffers[index] = content
        return self._buffers[index]

    def content_of(self, uri: Any, kind: FileKind) -> bytes | None:
        """Content of a URI: data in it, or a file beside the mesh; None if there is none."""
        if not isinstance(uri, str):
            raise self.source.fault(f"uri {uri!r:.40}", "text")
        if not uri.startswith("data:"):
            return self.source.read(urllib.parse.unquote(uri), kind)
        head, _, data = uri.partition(",")
        try:
            return base64.b64decode(data) if head.endswith(";base64") else urllib.parse.unquote_to_bytes(data)
        except binascii.Error:
            raise self.source.fault("data in a uri that is no base64", "it") from None

    def picture(self, index: Any) -> np.ndarray | None:
        """sRGB codes and opacity (h, w, 4) of an image; None, with a note, if it is missing."""
        entry = self.entry("images", index)
        name = str(entry.get("name", f"image {index}"))
        if "bufferView" in entry:
            return self.source.decode(self.view(entry["bufferView"])[0], name)
        uri = entry["uri"]
        if isinstance(uri, str) and not uri.startswith("data:"):
            return self.source.picture(urllib.parse.unquote(uri))
        content = self.content_of(uri, FileKind.PICTURE)
        return None if content is None else self.source.decode(content, name)

    def extensions(self) -> Iterator[str]:
        """Name of each extension, as often as an object has it; once if the file only lists it."""
        found, level = list[str](), [self.json]
        while level:
            below: list[Any] = []
            for value in level:
                if isinstance(value, dict):
                    extensions = value.get("extensions")
                    found += list(extensions) if isinstance(extensions, dict) else []
                    below += value.values()
                elif isinstance(value, list):
                    below += value
            level = [value for value in below if isinstance(value, dict | list)]
        listed = [each for each in self.json.get("extensionsUsed", []) if isinstance(each, str) and each not in found]
        yield from [*found, *listed]


def _chunks(source: MeshSource) -> tuple[bytes, bytes | None]:
    """JSON and binary part of a file, which is JSON alone if it does not begin as a container."""
    content = source.content
    if source.path.suffix.lower() == ".gltf":
        return content, None
    if content[:4] != _MAGIC or len(content) < 20:
        raise source.fault("a container that cannot be read", "a file that begins with 'glTF'")
    version, length = (int.from_bytes(content[start : start + 4], "little") for start in (4, 8))
    if version != 2:
        raise source.fault(f"a container of version {version}", "2")
    if length > len(content):
        raise source.fault(f"{len(content)} bytes", f"{length}, as its header says")
    parts, start = dict[int, bytes](), 12
    while start + 8 <= length:
        size, kind = (int.from_bytes(content[place : place + 4], "little") for place in (start, start + 4))
        if start + 8 + size > length:
            raise source.fault(f"a part of {size} bytes beyond its end", "parts inside")
        parts.setdefault(kind, content[start + 8 : start + 8 + size])
        start += 8 + size + (-size % 4)
    if _JSON not in parts:
        raise source.fault("a container without JSON", "it as its first part")
    return parts[_JSON], parts.get(_BINARY)
