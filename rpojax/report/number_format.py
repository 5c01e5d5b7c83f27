"""Text of numbers, p-values and units."""

import math


def with_unit(text: str, unit: str) -> str:
    """Text of a number followed by its unit, which is empty for a pure number."""
    return f"{text} {unit}" if unit else text


def format_number(value: float | None, digits: int = 4) -> str:
    """`value` with `digits` significant digits, integers without decimals, a dash for None or NaN."""
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    if value == 0.0 or (float(value).is_integer() and abs(value) < 1e6):
        return f"{value:.0f}"
    magnitude = math.floor(math.log10(abs(value)))
    if magnitude < -6 or magnitude > 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - magnitude)}f}"


def format_percent_interval(low: float, high: float) -> str:
    """Interval of a probability in percent, with two significant digits."""
    ends = (100.0 * end for end in (low, high))
    return " to ".join("100" if end >= 99.5 else f"{end:.2g}" for end in ends) + " %"


def format_p_value(p: float | None) -> str:
    """P-value with two significant digits, a dash for None."""
    return format_number(None) if p is None else f"{p:.2g}"
