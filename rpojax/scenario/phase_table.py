"""Phases of a scenario as static settings of the mission and as its parameters."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.flight.control import periodic_lqr_gain
from rpojax.flight.guidance.references.approach import Approach
from rpojax.flight.guidance.references.fly_around import FlyAround
from rpojax.flight.guidance.references.hold import Hold
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit
from rpojax.flight.guidance.references.retreat import Retreat
from rpojax.flight.guidance.references.transfer import Transfer
from rpojax.flight.mission.phase_table import Corridor, MissionTuning, Phase, Until
from rpojax.flight.mission.static_mission_settings import MissionSettings, PhaseSettings
from rpojax.scenario import key_units
from rpojax.scenario.phases.phase_sections import PhaseSection
from rpojax.scenario.phases.reference_sections import HoldSection
from rpojax.scenario.schema import ScenarioFile

Table = Mapping[str, Any]

REFERENCES: Final[dict[str, type]] = {
    "hold": Hold,
    "relative_orbit": RelativeOrbit,
    "transfer": Transfer,
    "fly_around": FlyAround,
    "approach": Approach,
    "retreat": Retreat,
}
"""Class of the reference by its kind."""

_NO_CONDITION: Final[dict[str, Any]] = {
    "time": 0.0,
    "arrival_box": [math.inf] * 3,
    "arrival_for": 0.0,
    "range_sigma": math.inf,
    "range_sigma_for": 0.0,
    "ground_go": 0.0,
}
"""Values of the conditions of `until` that always hold."""

_NEAR_CIRCLE: Final = 0.02
"""Eccentricity below which the gain for a circular orbit serves everywhere on the orbit [-]."""

_STATION: Final = "station"
"""Phase of a scenario without phases: holding the formation's desired position."""

_WAITING: Final = ("hold", "approach", "retreat")
"""Kinds of references that depend on the place alone, so that a servicer can stop on the way."""

_WEIGHTS: Final = ("position_weight", "velocity_weight", "delta_v_weight")


def control_period_s(file: ScenarioFile, phase: PhaseSection) -> float:
    """Time between the burn decisions of a phase [s]."""
    return phase.control_period_s or file.rates.formation_period_s


def mission_settings(file: ScenarioFile) -> MissionSettings:
    """Static settings of the mission of a scenario; one without phases holds its station, and nothing aborts that."""

    def ticks(seconds: float) -> int:
        return round(seconds * file.rates.camera_hz)

    def burns(control_period: float) -> int:
        if file.orbit.eccentricity < _NEAR_CIRCLE:
            return 1
        orbit_period = 2.0 * math.pi / float(mean_motion(jnp.float64(file.orbit.semi_major_axis_m)))
        return periodic_lqr_gain.burns_per_orbit(orbit_period, control_period)

    def tables(control_period: float) -> int:
        count = burns(control_period)
        return 1 if count == 1 else periodic_lqr_gain.tables_per_burn(file.orbit.eccentricity, count)

    station = PhaseSection(
        name=_STATION, reference=HoldSection(kind="hold", position_m=file.formation.desired_position_m)
    )
    decision_period_s = file.mission.decision_period_s if file.phases else file.rates.formation_period_s
    return MissionSettings(
        phases=tuple(
            PhaseSettings(
                name=phase.name,
                pointing=phase.pointing,
                control_ticks=ticks(control_period_s(file, phase)),
                burns_per_orbit=burns(control_period_s(file, phase)),
                gain_tables=tables(control_period_s(file, phase)),
                on_timeout=phase.on_timeout,
                ends=phase.until is not None,
                has_arrival_box=phase.until is not None and phase.until.arrival_box_m is not None,
                passively_safe=phase.passively_safe,
                has_corridor=phase.corridor is not None,
                stops_in_the_dark=phase.reference.kind in _WAITING and not phase.passively_safe,
            )
            for phase in file.phases or [station]
        ),
        is_managed=bool(file.phases),
        decision_ticks=ticks(decision_period_s),
        hold_ticks=ticks(file.rates.formation_period_s),
        hold_burns_per_orbit=burns(file.rates.formation_period_s),
        hold_gain_tables=tables(file.rates.formation_period_s),
    )


def mission_tuning(tables: Table) -> MissionTuning:
    """Parameters of the mission from the tables of a scenario."""
    sphere = [tables["limits"]["keep_out_m"]] * 3
    numbers = _numbers(tables["mission"])
    return MissionTuning(
        phases={phase["name"]: _phase(phase, sphere) for phase in tables["phases"] or [{"name": _STATION}]},
        keep_out=_array(sphere),
        **{field.name: numbers[field.name] for field in fields(MissionTuning) if field.name in numbers},
    )


def leaf_path(key: str) -> tuple[str, ...]:
    """Attribute path in the mission's parameters of a key such as `phases.hold.timeout_s` or `mission.abort_at_s`."""
    *path, name = key.removeprefix("mission.").split(".")
    return (*path, key_units.split_unit(name)[0])


def _phase(table: Table, sphere: list[float]) -> Phase:
    until, corridor, reference = table.get("until") or {}, table.get("corridor"), table.get("reference")
    weights = {name: table.get(name) for name in _WEIGHTS}
    return Phase(
        reference=None if reference is None else _reference(reference),
        until=Until(**({name: _array(value) for name, value in _NO_CONDITION.items()} | _numbers(until))),
        timeout=_array(table.get("timeout_s", math.inf)),
        keep_out=_array(table.get("keep_out_m", sphere)),
        corridor=None if corridor is None else Corridor(**_numbers(corridor)),
        **{name: None if value is None else _array(value) for name, value in weights.items()},
    )


def _reference(table: Table) -> Any:
    """Record of a reference trajectory."""
    return REFERENCES[table["kind"]](**_numbers({name: value for name, value in table.items() if name != "kind"}))


def _numbers(table: Table) -> dict[str, Array]:
    """Numbers of a section in SI and radians, by name without unit."""
    units = {key: key_units.split_unit(key) for key in table}
    return {name: _array(table[key], factor) for key, (name, factor) in units.items()}


def _array(value: Any, factor: float = 1.0) -> Array:
    # Without operations of JAX, each of which would compile a program at the first start.
    return jax.device_put(np.asarray(value, dtype=np.float64) * factor)
