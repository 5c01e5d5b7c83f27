"""Import of optional packages."""

import importlib
from types import ModuleType

from rpojax.errors import RpojaxError


class MissingExtraError(RpojaxError):
    """A command needs a package that is not installed."""


def require_package(name: str, extra: str = "raytrace") -> ModuleType:
    """Module of an optional package; raises `MissingExtraError` with the line that installs it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingExtraError(f"{name}: not installed, expected: pip install 'rpojax[{extra}]'") from None
