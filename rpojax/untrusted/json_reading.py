"""Reading of JSON that is not trusted."""

import json
from pathlib import Path
from typing import Any

from rpojax.untrusted.file_reading import FileKind, read_bytes
from rpojax.untrusted.structure_limits import StructureError, check_structure
from rpojax.untrusted.text_reading import EncodingError, decode_text


def read_json(path: Path, kind: FileKind) -> Any:
    """Content of a JSON file.

    Raises:
        FileError: it cannot be read.
        StructureError: it is no JSON, or beyond the limits on structure.
    """
    return parse_json(read_bytes(path, kind))


def parse_json(text: str | bytes) -> Any:
    """Content of a text in JSON, of finite numbers.

    Raises:
        StructureError: it is no JSON, or beyond the limits on structure.
    """
    try:
        content = json.loads(text)
    except RecursionError:
        raise StructureError("found JSON that is too deep, expected a few levels") from None
    except UnicodeDecodeError as error:
        reason = _encoding(text) if isinstance(text, bytes) else str(error)
        raise StructureError(f"found {reason}, expected JSON") from None
    except ValueError as error:
        raise StructureError(f"found no JSON ({error!s:.100}), expected it") from None
    check_structure(content)
    return content


def _encoding(content: bytes) -> str:
    """What bytes that no encoding of JSON fits look like."""
    try:
        decode_text(content)
    except EncodingError as error:
        return error.found
    return "no text"
