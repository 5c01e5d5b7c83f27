"""Numbers of the images of the rendered camera and of its detector."""

from jaxtyping import Array

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree


@pytree
class Imaging:
    """Exposure of the camera and threshold of the detector."""

    exposure: Array = number("gain: 1 is the white level of the field at full well", above=0.0)
    full_well: Array = number("electrons at saturation", above=0.0)
    read_noise: Array = number("noise of reading in electrons, 1 sigma", at_least=0.0)
    blur: Array = number("point spread function, 1 sigma", unit="px", at_least=0.0, at_most=1.0)
    bloom: Array | None = number(
        "fraction of the light that the optics scatter into a halo; by default none",
        at_least=0.0,
        below=1.0,
        default=None,
    )
    bloom_radius: Array = number("halo, 1 sigma", unit="px", above=0.0, default=6.0)
    exposure_time: Array | None = number(
        "time during which the target moves in the picture; by default it does not",
        unit="s",
        at_least=0.0,
        default=None,
    )
    fill_light: Array = number(
        "irradiance from the Earth's side, relative to the Sun's, that is added to the light of the sunlit ground "
        "while the Sun is in view: an assumption, for the air past the terminator and the servicer's own surfaces",
        at_least=0.0,
        default=0.1,
    )
    score_threshold: Array = number("boxes with a lower score are discarded", at_least=0.0, at_most=1.0)
