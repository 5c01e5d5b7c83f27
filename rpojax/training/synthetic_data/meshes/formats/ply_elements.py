"""Elements of PLY files: tables of numbers and lists, in text and binary of either byte order.

Source: Turk, The PLY Polygon File Format, 1994.
"""

import dataclasses
import warnings
from collections.abc import Iterator, Mapping

import numpy as np

from rpojax.training.synthetic_data.meshes.formats.mesh_source import MeshSource

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
    "int64": "i8",
    "uint64": "u8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1_000_000


@dataclasses.dataclass(frozen=True)
class Property:
    """A property: type of its values, and of the lengths of its lists if it has lists."""

    name: str
    kind: str
    length_kind: str | None


@dataclasses.dataclass(frozen=True)
class Lists:
    """A list for each row: lengths (n,), and the values of all one after the other."""

    sizes: np.ndarray
    values: np.ndarray


@dataclasses.dataclass(frozen=True)
class Element:
    """An element of a file.

    Attributes:
        count: number of its rows
        properties: as the header names them
        columns: numbers (n,) as float64 by property; lists by property
        lists: lists by property
    """

    count: int
    properties: Mapping[str, Property]
    columns: Mapping[str, np.ndarray]
    lists: Mapping[str, Lists]


@dataclasses.dataclass(frozen=True)
class Header:
    """Header of a file: byte order, '' for text, the elements with their properties, and the comments."""

    order: str
    elements: dict[str, tuple[int, list[Property]]]
    comments: list[str]
    end: int


def read_header(source: MeshSource) -> Header:
    """Header of a file.

    Raises:
        MeshError: it is not as expected.
    """
    elements: dict[str, tuple[int, list[Property]]] = {}
    order, comments, properties = None, list[str](), None
    for number, (line, end) in enumerate(_header_lines(source)):
        words = line.split()
        match words:
            case ["ply"] if number == 0:
                pass
            case _ if number == 0:
                raise source.fault(f"{line!r:.60} in its first line", "'ply'")
            case ["format", form, version] if form in _ORDERS and version == "1.0":
                order = _ORDERS[form]
            case ["comment", *_]:
                comments.append(line.partition("comment")[2].strip())
            case [] | ["obj_info", *_]:
                pass
            case ["element", name, count] if count.isdecimal() and name not in elements:
                if int(count) > len(source.content):
                    raise source.fault(f"{count} rows of {name!r:.40}", "at most as many as the file has bytes")
                properties = list[Property]()
                elements[name] = int(count), properties
            case ["property", kind, name] if kind in _TYPES and properties is not None:
                properties.append(Property(name, _TYPES[kind], None))
            case ["property", "list", length, kind, name] if (
                length in _TYPES and kind in _TYPES and properties is not None and _TYPES[length][0] != "f"
            ):
                properties.append(Property(name, _TYPES[kind], _TYPES[length]))
            case ["end_header"] if order is not None:
                return Header(order, elements, comments, end)
            case _:
                raise source.fault(f"{line!r:.60} in its header", "a format, elements and properties of a PLY file")
    raise source.fault("a header without its end", "'end_header'")


def _header_lines(source: MeshSource) -> Iterator[tuple[str, int]]:
    """Lines of the header, each with the place at which the next line begins; any line end is accepted."""
    start = 0
    while start < min(len(source.content), _LONGEST_HEADER):
        ends = [place for mark in (b"\n", b"\r") if (place := source.content.find(mark, start)) >= 0]
        end = min(ends, default=len(source.content))
        line = source.content[start:end].decode("latin-1").strip()
        start = end + (2 if source.content[end : end + 2] == b"\r\n" else 1)
        yield line, start


def read_elements(source: MeshSource, header: Header) -> dict[str, Element]:
    """All elements of a file.

    Raises:
        MeshError: the file ends too early.
    """
    read = _Text(source, header.end) if not header.order else _Binary(source, header.end, header.order)
    found = {}
    for name, (count, properties) in header.elements.items():
        if len({entry.name for entry in properties}) < len(properties):
            raise source.fault(f"a property twice in {name!r:.40}", "distinct names")
        found[name] = read.element(name, count, properties)
    read.finish()
    return found


class _Text:
    """Rows of a file in text, as numbers one after the other."""

    def __init__(self, source: MeshSource, start: int) -> None:
        self._source = source
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                self._numbers = np.fromstring(source.content[start:].decode("ascii"), sep=" ")
        except (ValueError, DeprecationWarning):
            raise source.fault("something else than numbers after its header", "the rows of its elements") from None
        if not source.content[start:].strip():
            self._numbers = np.zeros(0)
        self._place = 0

    def element(self, name: str, count: int, properties: list[Property]) -> Element:
        width = self._fixed_width(count, properties)
        if width is None:
            return self._uneven(name, count, properties)
        block = self._take(name, count * width).reshape(count, width)
        columns, lists, place = {}, {}, 0
        for each in properties:
            if each.length_kind is None:
                columns[each.name] = block[:, place]
                place += 1
            else:
                size = int(block[0, place])
                lists[each.name] = Lists(np.full(count, size), block[:, place + 1 : place + 1 + size].reshape(-1))
                place += 1 + size
        return Element(count, {entry.name: entry for entry in properties}, columns, lists)

    def _fixed_width(self, count: int, properties: list[Property]) -> int | None:
        """Numbers of a row if all rows have lists of the lengths of the first one."""
        if not any(entry.length_kind for entry in properties):
            return len(properties)
        places, width = [], 0
        for each in properties:
            if each.length_kind is not None:
                place = self._place + width
                if not (count and place < len(self._numbers) and 0 <= self._numbers[place] < 1e6):
                    return None
                places.append(width)
                width += int(self._numbers[place])
            width += 1
        if self._place + count * width > len(self._numbers):
            return None
        block = self._numbers[self._place : self._place + count * width].reshape(count, width)
        return width if (block[:, places] == block[0, places]).all() else None

    def _take(self, name: str, count: int) -> np.ndarray:
        found = self._numbers[self._place : self._place + count]
        self._place += count
        if len(found) < count:
            raise self._source.fault(f"the end of the file within {name!r:.40}", "all rows that its header says")
        return found

    def _uneven(self, name: str, count: int, properties: list[Property]) -> Element:
        rows = _Rows(properties)
        for _ in range(count):
            for each in properties:
                if each.length_kind is None:
                    rows.add(each, self._take(name, 1))
                else:
                    rows.add(each, self._take(name, _length(self._source, float(self._take(name, 1)[0]))))
        return rows.element(count)

    def finish(self) -> None:
        if self._place < len(self._numbers):
            self._source.notes.add("numbers after the last element, not used", "", len(self._numbers) - self._place)


class _Binary:
    """Rows of a binary file."""

    def __init__(self, source: MeshSource, start: int, order: str) -> None:
        self._source, self._place, self._order = source, start, order

    def element(self, name: str, count: int, properties: list[Property]) -> Element:
        sizes = self._first_sizes(count, properties)
        if sizes is None:
            return self._uneven(name, count, properties)
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for index, each in enumerate(properties):
            if each.length_kind is not None:
                fields.append((f"length {index}", self._order + each.length_kind))
                fields.append((f"value {index}", self._order + each.kind, (sizes[index],)))
            else:
                fields.append((f"value {index}", self._order + each.kind))
        kind = np.dtype(fields)
        if kind.itemsize == 0 or count == 0:
            return _Rows(properties).element(count if not properties else 0)
        if self._place + count * kind.itemsize > len(self._source.content):
            return self._uneven(name, count, properties)
        block = np.frombuffer(self._source.content, kind, count, self._place)
        if any((block[f"length {index}"] != size).any() for index, size in sizes.items()):
            return self._uneven(name, count, properties)
        self._place += count * kind.itemsize
        columns, lists = {}, {}
        for index, each in enumerate(properties):
            values = block[f"value {index}"].astype(np.float64)
            if each.length_kind is None:
                columns[each.name] = values
            else:
                lists[each.name] = Lists(np.full(count, sizes[index]), values.reshape(-1))
        return Element(count, {entry.name: entry for entry in properties}, columns, lists)

    def _first_sizes(self, count: int, properties: list[Property]) -> dict[int, int] | None:
        """Lengths of the lists of the first row by number of their property; None if it does not fit the file."""
        place, sizes = self._place, dict[int, int]()
        for index, each in enumerate(properties):
            if each.length_kind is not None and count:
                length = np.dtype(self._order + each.length_kind)
                if place + length.itemsize > len(self._source.content):
                    return None
                size = int(np.frombuffer(self._source.content, length, 1, place)[0])
                if not 0 <= size < 1_000_000:
                    return None
                sizes[index] = size
                place += length.itemsize + size * np.dtype(each.kind).itemsize
            else:
                place += np.dtype(each.kind).itemsize
        return sizes

    def _take(self, name: str, kind: str, count: int) -> np.ndarray:
        form = np.dtype(self._order + kind)
        if self._place + count * form.itemsize > len(self._source.content):
            raise self._source.fault(f"the end of the file within {name!r:.40}", "all rows that its header says")
        found = np.frombuffer(self._source.content, form, count, self._place)
        self._place += count * form.itemsize
        return found

    def _uneven(self, name: str, count: int, properties: list[Property]) -> Element:
        rows = _Rows(properties)
        for _ in range(count):
            for each in properties:
                number = 1
                if each.length_kind is not None:
                    number = _length(self._source, float(self._take(name, each.length_kind, 1)[0]))
                rows.add(each, self._take(name, each.kind, number))
        return rows.element(count)

    def finish(self) -> None:
        rest = self._source.content[self._place :].strip()
        if rest:
            self._source.notes.add("bytes after the last element, not used", "", len(rest))


class _Rows:
    """Rows of an element whose lists have different lengths."""

    def __init__(self, properties: list[Property]) -> None:
        self._properties = properties
        self._found: dict[str, list[np.ndarray]] = {entry.name: [] for entry in properties}

    def add(self, each: Property, values: np.ndarray) -> None:
        self._found[each.name].append(values)

    def element(self, count: int) -> Element:
        columns, lists = {}, {}
        for each in self._properties:
            rows = self._found[each.name]
            values = np.concatenate([np.zeros(0), *rows]).astype(np.float64)
            if each.length_kind is None:
                columns[each.name] = values
            else:
                lists[each.name] = Lists(np.array([len(row) for row in rows], np.int64), values)
        return Element(count, {entry.name: entry for entry in self._properties}, columns, lists)


def _length(source: MeshSource, value: float) -> int:
    if not 0 <= value < 1e6 or value != int(value):
        raise source.fault(f"a list of {value:g} values", "a number from 0 on")
    return int(value)
