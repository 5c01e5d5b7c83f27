"""PNG export of matplotlib figures, and the names of the Hill axes."""

import io
from typing import Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

AXIS_NAMES: Final = ("x radial", "y along-track", "z normal")
_PIXELS_PER_INCH = 160


def png_bytes(figure: Figure) -> bytes:
    """Figure as the bytes of a PNG file."""
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_PIXELS_PER_INCH)
    return buffer.getvalue()
