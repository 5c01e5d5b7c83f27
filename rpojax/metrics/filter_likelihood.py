"""Negative log likelihoods of the orbit filter, objectives of its tuning; evaluated during the simulation alone."""

import math
from types import ModuleType
from typing import Final

from rpojax.metrics.metric_definition import Metric, Quantity, WeightedValue

FALSE_BOX_PROBABILITY: Final = 0.05
"""Prior probability of a false box in `innovation_surprise`, independent of the gate."""
_FALSE_BOX_LOG_SIZE_RANGE: Final = 3.0
"""Range of the log size of false boxes, from a few pixels to the whole frame; the density is uniform."""


def _of_innovations(
    xp: ModuleType,
    innovation: Quantity,
    variance: Quantity,
    used: Quantity,
    received: Quantity,
    truncated: Quantity,
    image_area: Quantity,
) -> WeightedValue:
    """Per row, with a mixture of true and false boxes in place of the gate.

    Rows are those of GPS, of the box's bearing and size, and of additional sensors.
    """
    log_densities = -0.5 * (xp.log(2.0 * math.pi * variance) + innovation**2 / variance)
    gps_rows, sensor_rows = (xp.where(used[..., part], 1.0, 0.0) for part in (slice(3), slice(6, None)))
    size_row = xp.where(truncated, 0.0, 1.0)
    gps = xp.sum(gps_rows * log_densities[..., :3], axis=-1)
    true_box = log_densities[..., 3] + log_densities[..., 4] + size_row * log_densities[..., 5]
    false_box = -xp.log(image_area) - size_row * math.log(_FALSE_BOX_LOG_SIZE_RANGE)
    mixture = xp.logaddexp(math.log1p(-FALSE_BOX_PROBABILITY) + true_box, math.log(FALSE_BOX_PROBABILITY) + false_box)
    sensors = xp.sum(sensor_rows * log_densities[..., 6:], axis=-1)
    rows = xp.sum(gps_rows, axis=-1) + xp.sum(sensor_rows, axis=-1) + xp.where(received, 2.0 + size_row, 0.0)
    total = gps + sensors + xp.where(received, mixture, 0.0)
    return WeightedValue(-total / xp.where(rows > 0.0, rows, 1.0), rows)


METRICS: Final = (
    Metric(
        "innovation_surprise",
        "-",
        title="Innovation surprise",
        meaning="Negative log likelihood of the measurements under the prediction of the filter, per row.",
        inputs=(
            "innovation",
            "innovation_variance",
            "innovation_used",
            "box_received",
            "box_truncated",
            "image_area",
        ),
        value=_of_innovations,
        reduction="mean",
        has_derivative=True,
        source="simulation",
    ),
    Metric(
        "estimate_surprise",
        "-",
        title="Estimate surprise",
        meaning="Negative log likelihood of the truth under the estimate, per component.",
        inputs=("nees", "log_determinant"),
        value=lambda _, nees, log_determinant: 0.5 * ((nees + log_determinant) / 12.0 + math.log(2.0 * math.pi)),
        reduction="mean",
        has_derivative=True,
        source="simulation",
    ),
)
