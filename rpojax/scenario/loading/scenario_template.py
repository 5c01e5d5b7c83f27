"""A commented scenario file to begin with: keys that people change first, with the values of the extended scenario."""

from typing import Any, Final

import tomli_w

from rpojax.dispersions.kinds.registry import kind_class
from rpojax.scenario.loading.table_merging import key_names
from rpojax.scenario.schema import FORMAT_VERSION, ScenarioFile

_FIRST_KEYS: Final = (
    ("", (("duration_s", "a whole number of camera periods"), ("epoch_utc", "for the positions of Sun and Moon"))),
    (
        "orbit",
        (
            ("semi_major_axis_m", "of the target"),
            ("eccentricity", ""),
            ("inclination_deg", ""),
            ("raan_deg", ""),
        ),
    ),
    ("initial", (("relative_position_m", "servicer from target: radial, along track, orbit normal"),)),
    ("servicer", (("mass_kg", ""),)),
    ("target", (("mass_kg", "with effects.drag or solar_pressure"), ("tumble_rate_deg_s", ""))),
    ("thruster", (("force_n", ""),)),
    (
        "camera",
        (
            ("model", "geometric, statistical or rendered"),
            ("field_of_view_deg", ""),
            ("miss_probability", "of frames in which the target could be seen"),
        ),
    ),
    ("gps", (("noise_m", "1 sigma of each axis"),)),
    ("formation", (("desired_position_m", "station; without effect in a mission with phases"),)),
    ("rates", (("formation_period_s", "from one burn decision to the next"),)),
    ("limits", (("propellant_kg", ""), ("arrive_by_s", "on station from then on; shorter runs are not judged"))),
)
"""Section -> keys, each with a comment."""


def template(name: str, base: str, file: ScenarioFile) -> str:
    """Text of a scenario file of a name that extends `base`, which is `file`; every key is commented out."""
    tables = file.model_dump()
    of_kinds = [entry for entry in tables["dispersions"] if not _uses_nominal(entry["kind"])]
    replaced = {key for entry in of_kinds for key in key_names(entry)}
    lines = [
        "#:schema ./rpojax.schema.json",
        "# Completion in editors: rpojax schema --partial > rpojax.schema.json",
        "# All keys: docs/reference/scenario.md. Commented out, they have the values of the scenario that is extended.",
        "",
        f"format_version = {FORMAT_VERSION}",
        _assignment("extends", base),
        _assignment("name", name),
        _assignment("description", f"My variant of {base}"),
    ]
    for section, keys in _FIRST_KEYS:
        values, prefix = (tables[section], f"{section}.") if section else (tables, "")
        if section:
            lines += ["", f"[{section}]"]
        for key, text in keys:
            if prefix + key in replaced:
                lines.append(f"# {key}: a dispersion of {base} gives every run its own, see below")
            else:
                lines.append(f"# {_assignment(key, values[key])}" + (f"  # {text}" if text else ""))
    lines += ["", *_goal(file), *_requirement(), "", *_dispersion(), ""]
    return "\n".join(lines)


def _uses_nominal(kind: str) -> bool:
    found = kind_class(kind)
    return found is None or found.uses_nominal


def _goal(file: ScenarioFile) -> list[str]:
    """Goal of a mission of phases, none without."""
    if not file.phases:
        return []
    return [
        "# What a run must have reached by its end; a run that has not is unfinished.",
        "# [goal]",
        f"# {_assignment('phase', file.goal.phase or file.phases[-1].name)}",
        "",
    ]


def _requirement() -> list[str]:
    return [
        "# A requirement of your own; the list replaces that of the scenario that is extended.",
        "# [[requirements]]",
        '# metric = "min_range_m"',
        '# bound = "at least"',
        "# limit = 20.0",
        "# probability = 0.99",
        "# consumer_risk = 0.1",
    ]


def _dispersion() -> list[str]:
    return [
        '# A number that varies from run to run; kind = "none" removes one of the scenario that is extended.',
        "# [[dispersions]]",
        '# key = "gps.noise_m"',
        '# kind = "uniform"',
        "# low = 1.0",
        "# high = 5.0",
    ]


def _assignment(key: str, value: Any) -> str:
    """A line of TOML; lists of numbers stay on one line."""
    if isinstance(value, list):
        return f"{key} = [{', '.join(_assignment('x', each).partition(' = ')[2] for each in value)}]"
    return tomli_w.dumps({key: value}).rstrip("\n")
