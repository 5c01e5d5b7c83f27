"""Negative log likelihoods of the orbit filter, objectives of its tuning; evaluated during the simulation alone."""

import math
from types import ModuleType
from typing import Final

from rpojax.metrics.metric_definition import Metric, Quantity, WeightedValue

FALSE_BOX_PROBABILITY: Final = 0.05
"""Prior probability of a false box in `innovation_surprise`, independent of the gate."""
_FALSE_BOX_LOG_SIZE_RANGE: Final = 3.0
"""Range of the log size of false boxes, from a few pixels to the whole frame; the density is uniform."""


def _of_innovations(xp: ModuleType, sensors: Quantity, truncated: Quantity, image_area: Quantity) -> WeightedValue:
    """Per row of the innovations of `sensors` by name, with a mixture of true and false boxes in place of the gate."""
    log_densities = {
        name: -0.5 * (xp.log(2.0 * math.pi * each.variance) + each.innovation**2 / each.variance)
        for name, each in sensors.items()
    }
    box, of_box = sensors["box"], log_densities.pop("box")
    size_row, received = xp.where(truncated, 0.0, 1.0), box.accepted | box.rejected
    true_box = of_box[..., 0] + of_box[..., 1] + size_row * of_box[..., 2]
    false_box = -xp.log(image_area) - size_row * math.log(_FALSE_BOX_LOG_SIZE_RANGE)
    mixture = xp.logaddexp(math.log1p(-FALSE_BOX_PROBABILITY) + true_box, math.log(FALSE_BOX_PROBABILITY) + false_box)
    counts = {name: xp.where(sensors[name].used, 1.0, 0.0) for name in log_densities}
    total = sum(xp.sum(counts[name] * each, axis=-1) for name, each in log_densities.items())
    total = total + xp.where(received, mixture, 0.0)
    rows = sum(xp.sum(each, axis=-1) for each in counts.values()) + xp.where(received, 2.0 + size_row, 0.0)
    return WeightedValue(-total / xp.where(rows > 0.0, rows, 1.0), rows)


METRICS: Final = (
    Metric(
        "innovation_surprise",
        "-",
        title="Innovation surprise",
        meaning="Negative log likelihood of the measurements under the prediction of the filter, per row.",
        inputs=("innovations", "box_truncated", "image_area"),
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
