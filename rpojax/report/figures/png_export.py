"""PNG export of matplotlib figures, and the names of the Hill axes."""

import io
from typing import Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

AXIS_NAMES: Final = ("x radial", "y along-track", "z normal")
_PIXELS_PER_INCH = 160


def png_bytes(figure: Figure) -> bytes:
    """Figure as the bytes of a PNG file."""
    figure.set_dpi(_PIXELS_PER_INCH)
    canvas = FigureCanvasAgg(figure)
    # `savefig` would draw twice, once for the layout alone.
    canvas.draw()
    buffer = io.BytesIO()
    imsave(buffer, canvas.buffer_rgba(), format="png", origin="upper", dpi=_PIXELS_PER_INCH)
    return buffer.getvalue()
