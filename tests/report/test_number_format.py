"""Text of numbers."""

import numpy as np
import pytest

from rpojax.report.labels import format_number

_DASH = "\N{EN DASH}"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, _DASH),
        (np.nan, _DASH),
        (0.0, "0"),
        (12.0, "12"),
        (0.41953, "0.4195"),
        (12345.678, "12346"),
        (2.5e-6, "0.000002500"),
        (3.2e-7, "3.200e-07"),
    ],
)
def test_numbers_have_four_significant_digits(value, text):
    assert format_number(value) == text
