"""Phases of a scenario as static settings of the mission and as its parameters."""

import math
from collections.abc import Mapping
from typing import Any, Final

import jax.numpy as jnp

from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.flight.control import periodic_lqr_gain
from rpojax.flight.guidance.references.approach import Approach
from rpojax.flight.guidance.references.arc import Arc
from rpojax.flight.guidance.references.fly_around import FlyAround
from rpojax.flight.guidance.references.hold import Hold
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit
from rpojax.flight.guidance.references.retreat import Retreat
from rpojax.flight.guidance.references.transfer import Transfer
from rpojax.flight.mission.phase_table import Corridor, MissionTuning, Phase, Until
from rpojax.flight.mission.static_mission_settings import MissionSettings, PhaseSettings
from rpojax.scenario.numbers import key_units
from rpojax.scenario.numbers.section_records import array, section_record
from rpojax.scenario.phases.phase_sections import PhaseSection
from rpojax.scenario.phases.reference_sections import HoldSection
from rpojax.scenario.schema import ScenarioFile

Table = Mapping[str, Any]

REFERENCES: Final[dict[str, type]] = {
    "hold": Hold,
    "relative_orbit": RelativeOrbit,
    "transfer": Transfer,
    "fly_around": FlyAround,
    "arc": Arc,
    "approach": Approach,
    "retreat": Retreat,
}
"""Class of the reference by its kind."""

_NO_CONDITION: Final[dict[str, Any]] = {
    "time_s": 0.0,
    "arrival_box_m": [math.inf] * 3,
    "arrival_for_s": 0.0,
    "range_sigma_m": math.inf,
    "range_sigma_for_s": 0.0,
    "attitude_sigma_deg": math.inf,
    "attitude_sigma_for_s": 0.0,
    "ground_go_s": 0.0,
}
"""Values of the conditions of `until` that always hold."""

_NEAR_CIRCLE: Final = 0.02
"""Eccentricity below which the gain for a circular orbit serves everywhere on the orbit [-]."""

_STATION: Final = "station"
"""Phase of a scenario without phases: holding the formation's desired position."""

_WAITING: Final = ("hold", "arc", "approach", "retreat")
"""Kinds of references that depend on the place alone, so that a servicer can stop on the way."""


def control_period_s(file: ScenarioFile, phase: PhaseSection) -> float:
    """Time between the burn decisions of a phase [s]; under continuous control it decides anew each tick."""
    if phase.control == "continuous":
        return 1.0 / file.rates.camera_hz
    return phase.control_period_s or file.rates.formation_period_s


def mission_settings(file: ScenarioFile) -> MissionSettings:
    """Static settings of the mission of a scenario; one without phases holds its station, and nothing aborts that."""

    def ticks(seconds: float) -> int:
        return round(seconds * file.rates.camera_hz)

    def burns(control_period: float, is_continuous: bool = False) -> int:
        # Within a tick the orbit changes no gain.
        if is_continuous or file.orbit.eccentricity < _NEAR_CIRCLE:
            return 1
        orbit_period = 2.0 * math.pi / float(mean_motion(jnp.float64(file.orbit.semi_major_axis_m)))
        return periodic_lqr_gain.burns_per_orbit(orbit_period, control_period)

    def tables(count: int) -> int:
        return 1 if count == 1 else periodic_lqr_gain.tables_per_burn(file.orbit.eccentricity, count)

    station = PhaseSection(
        name=_STATION,
        reference=HoldSection.model_validate({"kind": "hold", "position_m": file.formation.desired_position_m}),
    )
    decision_period_s = file.mission.decision_period_s if file.phases else file.rates.formation_period_s
    return MissionSettings(
        phases=tuple(
            PhaseSettings(
                name=phase.name,
                pointing=phase.pointing,
                control_ticks=ticks(control_period_s(file, phase)),
                burns_per_orbit=(count := burns(control_period_s(file, phase), phase.control == "continuous")),
                gain_tables=tables(count),
                on_timeout=phase.on_timeout,
                ends=phase.until is not None,
                has_arrival_box=phase.until is not None and phase.until.arrival_box_m is not None,
                passively_safe=phase.passively_safe,
                has_corridor=phase.corridor is not None,
                stops_in_the_dark=phase.reference.kind in _WAITING and not phase.passively_safe,
                translates=phase.control == "continuous",
                in_target_frame=phase.frame == "target",
            )
            for phase in file.phases or [station]
        ),
        is_managed=bool(file.phases),
        decision_ticks=ticks(decision_period_s),
        hold_ticks=ticks(file.rates.formation_period_s),
        hold_burns_per_orbit=(held := burns(file.rates.formation_period_s)),
        hold_gain_tables=tables(held),
    )


def mission_tuning(tables: Table) -> MissionTuning:
    """Parameters of the mission from the tables of a scenario."""
    sphere = [tables["limits"]["keep_out_m"]] * 3
    return section_record(
        MissionTuning,
        tables["mission"],
        phases={phase["name"]: _phase(phase, sphere) for phase in tables["phases"] or [{"name": _STATION}]},
        keep_out=array(sphere),
    )


def leaf_path(key: str) -> tuple[str, ...]:
    """Attribute path in the mission's parameters of a key such as `phases.hold.timeout_s` or `mission.abort_at_s`."""
    *path, name = key.removeprefix("mission.").split(".")
    return (*path, key_units.split_unit(name)[0])


def _phase(table: Table, sphere: list[float]) -> Phase:
    until, corridor, reference = table.get("until") or {}, table.get("corridor"), table.get("reference")
    return section_record(
        Phase,
        {"timeout_s": math.inf, "keep_out_m": sphere, **table},
        reference=None if reference is None else section_record(REFERENCES[reference["kind"]], reference),
        until=section_record(Until, _NO_CONDITION | until),
        corridor=None if corridor is None else section_record(Corridor, corridor),
    )
