"""Data of the interactive scatter plot."""

import json

from report_page_parser import rendered_page


def test_first_metric_is_the_formation_error_and_axes_use_plain_decimals(campaign):
    campaign.metrics = dict(sorted(campaign.metrics.items()))
    data = json.loads(rendered_page(campaign).data)
    assert next(iter(data["explorer"]["metrics"])) == "formation_error_rms_m"
    axis = data["charts"]["histogram-good_boxes_rejected_fraction"]["layout"]["xaxis"]
    assert axis["exponentformat"] == "none"
