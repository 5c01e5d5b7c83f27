"""A mesh file with the files beside it, the surfaces that are read from it, and notes of what is not used."""

import dataclasses
import io
import re
import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from rpojax.errors import RpojaxError
from rpojax.printable_text import cut, printable
from rpojax.training.synthetic_data.meshes.formats.ear_clipping import PolygonError, Triangles, triangulate
from rpojax.training.synthetic_data.meshes.target_mesh import Material
from rpojax.untrusted.file_reading import FileError, FileKind, absolute_path, is_regular, read_bytes
from rpojax.untrusted.text_reading import EncodingError, decode_text
from rpojax.vision.imaging.image_files import check_size

FACE_LIMIT = 2_000_000
"""Most triangles of a mesh."""
BEYOND = "colours and factors of materials beyond 0 to 1, cut to it"
"""Note of what may be codes of 8 bit, or no colours at all."""
_COMMENT = re.compile(r"(?:^|\s)#(?:\s|$)")
_MOST_DETAILS = 4
"""Details that a note lists; of further ones it has the number."""
_LONGEST_DETAIL = 80
_DRIVE = re.compile(r"[A-Za-z]:")


class MeshError(RpojaxError):
    """A mesh cannot be used as a target."""


@dataclasses.dataclass(frozen=True)
class Surface:
    """Triangles of one material as a file has them.

    Attributes:
        vertices: (n, 3) in units of the file
        faces: (m, 3)
        material: of all triangles
        uv: (n, 2) texture coordinates, v upwards, if the material has a texture
        colors: (m, 3) linear colours that replace that of the material
        alpha: (m,) opacity 0..1, by default 1
    """

    vertices: np.ndarray
    faces: np.ndarray
    material: Material = dataclasses.field(default_factory=Material)
    uv: np.ndarray | None = None
    colors: np.ndarray | None = None
    alpha: np.ndarray | None = None


class MeshNotes:
    """What of a mesh file is not used, or is read in another way than it says: one line for each kind."""

    def __init__(self) -> None:
        self._found: dict[str, dict[str, int]] = {}

    def add(self, kind: str, detail: object = "", number: int = 1) -> None:
        """Counts `number` findings of a kind, with an example such as the name of a picture."""
        details = self._found.setdefault(kind, {})
        words = cut(str(detail), _LONGEST_DETAIL)
        details[words] = details.get(words, 0) + number

    def lines(self) -> tuple[str, ...]:
        """The notes: kind, and details with how often each was found."""
        return tuple(_line(kind, details) for kind, details in self._found.items())


def _line(kind: str, details: dict[str, int]) -> str:
    listed = [f"{words} ({number})" if number > 1 else words for words, number in details.items()]
    if listed == [""]:
        return printable(kind)
    if set(details) == {""}:
        return printable(f"{kind}: {details['']}")
    further = [f"{len(listed) - _MOST_DETAILS} more"] if len(listed) > _MOST_DETAILS else []
    return printable(f"{kind}: {', '.join([*listed[:_MOST_DETAILS], *further])}")


class MeshSource:
    """A mesh file with the files beside it, which are read from its own folder alone.

    Args:
        path: of the mesh

    Raises:
        FileError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.content = read_bytes(path, FileKind.MESH)
        self.notes = MeshNotes()
        self._pictures: dict[Path, np.ndarray | None] = {}

    def fault(self, found: str, expected: str) -> MeshError:
        """Error about the content of the file."""
        return MeshError(f"{self.path}: found {found}, expected {expected}")

    def triangles(self, points: np.ndarray, sizes: np.ndarray) -> Triangles:
        """Triangles of polygons with `sizes` (p,) corners at `points` (c, 3); notes unusual polygons.

        Raises:
            MeshError: the outline of a polygon crosses itself, or it has too many corners.
        """
        try:
            found = triangulate(points, sizes)
        except PolygonError as error:
            raise self.fault(str(error), "faces with simple outlines") from None
        if found.bent:
            self.notes.add("faces that are not flat, divided in one of several ways", "", found.bent)
        if found.too_small:
            self.notes.add("faces of fewer than three corners, not used", "", found.too_small)
        return found

    def text(self) -> str:
        """Text of the file with line ends of one kind; other bytes than UTF-8, as in names, are read as Latin-1.

        Raises:
            MeshError: it is no text.
        """
        try:
            return _text(self.content)
        except EncodingError as error:
            raise self.fault(error.found, "a mesh in text") from None

    def finite(self, vertices: np.ndarray) -> np.ndarray:
        """The vertices.

        Raises:
            MeshError: one is not finite.
        """
        if not np.isfinite(vertices).all():
            raise self.fault("a vertex that is not finite", "finite coordinates")
        return vertices

    def find(self, name: str) -> Path | None:
        """File in the folder of the mesh by the name that the mesh gives, None if there is none.

        A name may have backslashes. One with an absolute path, another folder or letters of another case than here
        stands for the file of its last part beside the mesh, which is noted.
        """
        plain = name.replace("\\", "/")
        is_absolute = plain.startswith("/") or _DRIVE.match(plain) is not None
        last = plain.rpartition("/")[2]
        for place in [] if is_absolute else [name, plain]:
            if place and self._is_inside(self.path.parent / place):
                return self.path.parent / place
        for beside in (last, *self._alike(last)):
            if beside and self._is_inside(self.path.parent / beside):
                self.notes.add("files read from beside the mesh", f"{name!r} as {beside!r}")
                return self.path.parent / beside
        return None

    def read(self, name: str, kind: FileKind) -> bytes | None:
        """Content of a file beside the mesh, None if there is none.

        Raises:
            FileError: it cannot be read.
        """
        path = self.find(name)
        return None if path is None else read_bytes(path, kind)

    def text_of(self, name: str) -> str | None:
        """Text of a material library beside the mesh; None, with a note, if there is none that can be read."""
        try:
            content = self.read(name, FileKind.MESH)
            if content is not None:
                return _text(content)
            self.notes.add("material libraries not found beside the mesh", repr(name))
        except EncodingError as error:
            self.notes.add("material libraries that are no text, not used", f"{name!r} has {error.found}")
        except FileError as error:
            self.notes.add("material libraries that cannot be read, not used", f"{name!r} is {error.found}")
        return None

    def picture(self, name: str) -> np.ndarray | None:
        """sRGB codes and opacity (h, w, 4) of a picture beside the mesh; None, with a note, if there is none."""
        path = self.find(name)
        if path is None:
            self.notes.add("pictures not found beside the mesh, without which surfaces have one colour", repr(name))
            return None
        if path not in self._pictures:
            try:
                self._pictures[path] = self.decode(read_bytes(path, FileKind.PICTURE), name)
            except RpojaxError as error:
                self._unreadable(name, str(error))
                self._pictures[path] = None
        return self._pictures[path]

    def decode(self, content: bytes, name: str) -> np.ndarray | None:
        """sRGB codes and opacity (h, w, 4) of an encoded picture; None, with a note, if it is none."""
        try:
            check_size(Path(name), content)
            return _picture_codes(content)
        except RpojaxError as error:
            self._unreadable(name, str(error))
        # Decoders raise errors of many kinds.
        except Exception as error:
            self._unreadable(name, str(error))
        return None

    def _unreadable(self, name: str, reason: str) -> None:
        kind = "pictures that cannot be read, without which surfaces have one colour"
        self.notes.add(kind, f"{name!r}, {reason.removeprefix(f'{name}: ')}")

    def _is_inside(self, place: Path) -> bool:
        """Whether a path leads to a regular file in the folder of the mesh."""
        return is_regular(place) and absolute_path(place).is_relative_to(absolute_path(self.path.parent))

    def _alike(self, name: str) -> list[str]:
        """Files beside the mesh whose names differ from `name` in the case of letters alone."""
        try:
            return sorted(each.name for each in self.path.parent.iterdir() if each.name.lower() == name.lower())
        except OSError:
            return []


def _text(content: bytes) -> str:
    """Text of a mesh or material file.

    Raises:
        EncodingError: it is UTF-16 or UTF-32, or binary.
    """
    try:
        text = decode_text(content)
    except EncodingError:
        if b"\0" in content:
            raise
        text = content.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _picture_codes(content: bytes) -> np.ndarray:
    with warnings.catch_warnings():
        # The number of pixels is limited already.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        with Image.open(io.BytesIO(content)) as image:
            if image.mode.startswith("I"):  # grey of 16 bit, which a conversion would cut at 255
                if image.format == "TIFF" and image.mode == "I":
                    raise ValueError("codes of 32 bit, expected 8 or 16")
                grey = np.clip(np.asarray(image).astype(np.int64) >> 8, 0, 255).astype(np.uint8)
                return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
            if image.mode == "F":
                raise ValueError("numbers that are no codes of 8 or 16 bit")
            return np.asarray(image.convert("RGBA"))


def name_in(words: str) -> str:
    """A name as it stands in a line of OBJ and its libraries; `#` is part of it unless a space follows it."""
    return _COMMENT.split(words, maxsplit=1)[0].strip()


def linear_colors(codes: np.ndarray) -> np.ndarray:
    """Linear colours of sRGB codes in 0..1, or the codes' fractions of them, by the power law of displays."""
    return np.clip(codes, 0.0, 1.0) ** 2.2


def scaled_texture(picture: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """sRGB codes (h, w, 3) of a picture (h, w, 3 or more) whose linear colours are multiplied with `factor` (3,)."""
    codes = picture[..., :3]
    if (factor == 1.0).all():
        return codes
    return np.round(codes * np.clip(factor, 0.0, 1.0) ** (1.0 / 2.2)).astype(np.uint8)
