"""Units of the arrays that a campaign stores."""

from rpojax.metrics import metric_catalogue
from rpojax.scenario import key_units
from rpojax.simulation.metrics import phase_records, trace_channels

CHANNEL_UNITS = {
    **dict.fromkeys(("rho_H", "rho_estimate_H", "rho_desired_H", "r_ST_N", "r_TN_N"), "m"),
    **dict.fromkeys(("relative_error_H", "servicer_error_H", "target_error_H"), "m"),
    **dict.fromkeys(("relative_sigma_H", "servicer_sigma_H", "target_sigma_H"), "m"),
    "v_ST_N": "m/s",
}
"""Units of the channels of histories whose names do not end with them."""


def array_units(group: str, name: str) -> str:
    """Unit of an array of a group as text; 1 for dimensionless quantities."""
    match group.removeprefix("servicer_"):
        case "metrics":
            unit = metric_catalogue.unit_of(name)
        case "traces":
            unit = trace_channels.TRACE_UNITS.get(name, "-")
        case "status" | "events":
            unit = "s" if name.endswith("_s") else "-"
        case "phases":
            unit = phase_records.UNITS.get(name, "-")
        case "coverage":
            unit = "-"
        case "histories":
            unit = CHANNEL_UNITS.get(name) or key_units.unit_symbol(name)
        case _:
            unit = key_units.unit_symbol(name)
    return "1" if unit == "-" else unit
