"""Import of optional packages, and which extra of this package installs each."""

import importlib
from types import ModuleType

from rpojax.errors import RpojaxError

EXTRAS = {
    "mitsuba": "raytrace",
    "mpl_toolkits": "raytrace",
    "xarray": "xarray",
    "pandas": "xarray",
    "distributed": "dask",
    "rosbags": "ros",
    "cyclonedds": "ros",
    "rerun": "viz",
    "imageio_ffmpeg": "viz",
    "pyarrow": "formats",
    "sgp4": "formats",
}
"""Extra by the name under which an optional package is imported."""


class MissingExtraError(RpojaxError):
    """A command needs a package that is not installed."""


def require_package(name: str) -> ModuleType:
    """An optional package, or a module in it such as `rosbags.serde`.

    Raises:
        MissingExtraError: it is not installed; with the command that installs it.
    """
    extra = EXTRAS[name.partition(".")[0]]
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingExtraError(f"{name}: not installed, expected: pip install 'rpojax[{extra}]'") from None
