"""Names of the sources of deviation in a linear covariance."""

from collections.abc import Mapping

import numpy as np

HANDOVER, GPS_BIAS, GYRO_BIAS = "hand-over estimate", "GPS bias", "gyro bias"
STAR_TRACKER, GYRO, GPS, BOX = "star tracker noise", "gyro noise", "GPS noise", "box edge noise"
OUTLINE, BURN, DECISION = "target outline", "burn execution", "burn decision"


def source_names(columns: Mapping[str, np.ndarray]) -> list[str]:
    """Names of all sources, those of dispersions among the initial `columns` first."""
    other = (HANDOVER, GPS_BIAS, GYRO_BIAS, STAR_TRACKER, GYRO, GPS, BOX, OUTLINE, BURN, DECISION)
    return [*(name for name in columns if name not in other), *other]
