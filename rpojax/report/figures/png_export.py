"""PNG export of matplotlib figures, and the names of the Hill axes."""

import io
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

AXIS_NAMES: Final = ("x radial", "y along-track", "z normal")
_PIXELS_PER_INCH: Final = 160
_PALETTE_COLOURS: Final = 128
"""Enough for lines and letters with smooth edges, and a third of the bytes of full colours."""


def png_bytes(figure: Figure) -> bytes:
    """Figure as the bytes of a PNG file with a palette."""
    figure.set_dpi(_PIXELS_PER_INCH)
    canvas = FigureCanvasAgg(figure)
    # `savefig` would draw twice, once for the layout alone.
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    reduced = picture.quantize(_PALETTE_COLOURS, method=Image.Quantize.FASTOCTREE)
    reduced.save(buffer, format="png", dpi=(_PIXELS_PER_INCH, _PIXELS_PER_INCH))
    return buffer.getvalue()
