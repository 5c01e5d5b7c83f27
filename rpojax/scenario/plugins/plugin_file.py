"""Plugins in Python files, `mine.py:setup`: read within bounds, hashed and executed."""

import hashlib
import sys
from pathlib import Path
from types import ModuleType

from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario.plugins.function_digests import PLUGIN_MODULE
from rpojax.scenario.plugins.plugin import Plugin
from rpojax.untrusted.file_reading import FileError, FileKind, absolute_path, read_bytes
from rpojax.untrusted.text_reading import EncodingError, decode_text


def absolute_reference(reference: str, folder: Path) -> str:
    """Reference with the path of its file resolved from `folder`."""
    path, colon, function = reference.rpartition(":")
    return f"{absolute_path(folder / path)}:{function}" if colon and path else reference


def load(reference: str) -> tuple[str, Plugin]:
    """SHA-256 of the file of a reference `PATH:FUNCTION`, and the plugin that its function returns.

    Raises:
        ScenarioError: the file cannot be read or executed, or the function returns no plugin.
    """
    path, _, function = reference.rpartition(":")
    if not path or not function.isidentifier():
        raise ScenarioError("plugin", reference, "a Python file and a function in it, such as 'mine.py:setup'")
    source = _read(Path(path))
    digest = hashlib.sha256(source).hexdigest()
    module = _execute(Path(path), source, f"{PLUGIN_MODULE}{digest[:16]}")
    setup = getattr(module, function, None)
    if not callable(setup):
        raise ScenarioError("plugin", reference, f"a function {function!r} in that file")
    try:
        found = setup()
    except RpojaxError:  # it says what was found and expected, such as an argument that a stage does not have
        raise
    except Exception as error:
        raise _failure(reference, error) from error
    if not isinstance(found, Plugin):
        raise ScenarioError(
            "plugin", f"{type(found).__name__} from {function}", "a function that returns rpojax.Plugin"
        )
    return digest, found


def _read(path: Path) -> bytes:
    try:
        content = read_bytes(path, FileKind.PLUGIN)
        if not any(b"coding" in line for line in content.splitlines()[:2]):  # Python reads what a file declares
            decode_text(content)
    except FileError as error:
        raise ScenarioError("plugin", f"{path} ({error.found})", error.expected) from None
    except EncodingError as error:
        raise ScenarioError("plugin", f"{path} ({error.found})", "a Python file in UTF-8") from None
    return content


def _execute(path: Path, source: bytes, name: str) -> ModuleType:
    """Module of a source; it stays known to the process, so that `inspect` finds its functions."""
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module
    try:
        exec(compile(source, str(path), "exec"), module.__dict__)
    except Exception as error:
        del sys.modules[name]
        raise _failure(str(path), error) from error
    return module


def _failure(where: str, error: Exception) -> ScenarioError:
    text = " ".join(str(error).split())
    return ScenarioError("plugin", f"{type(error).__name__} ({text:.160}) in {where}", "Python that runs without error")
