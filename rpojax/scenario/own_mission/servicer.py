"""Servicer from its mass and thrust: inertia, surface, wheels, turns, burns."""

import math
from dataclasses import dataclass

import numpy as np

from rpojax.scenario.own_mission.choices import Choice, Choices, tidy, tidy_all, up_to
from rpojax.scenario.own_mission.facts import MissionFacts
from rpojax.scenario.own_mission.target_outline import MASS_RULE, side_of_mass

_SHAPE = np.array([[1.04, 0.01, 0.0], [0.01, 0.94, 0.01], [0.0, 0.01, 0.84]])
"""Inertia over that of a cube: parts are not quite symmetric."""
_HALF_TURN_S, _OF_SIDE_M = 35.0, 0.45
"""Time of a half turn of a cube of that side, and of smaller ones."""
_SETTLE_S, _MARGIN_S = 5.0, 5.0
_BURN_S, _LONGEST_BURN_S = 30.0, 180.0
_BURN_M_S = 0.03
"""Velocity change of the longest burn, if time allows."""
_ON_TIME_S, _LEAST_ON_TIME_S = 0.5, 0.02
_WHEEL_SPEED_RAD_S = 628.0
_OF_LEAST_BURN, _OF_DEAD_BAND = 100.0, 150.0
"""Distance over the drift in a burn period by the least burn, and by the dead band."""


@dataclass(frozen=True)
class Times:
    """Times that follow from turns and the orbit.

    Attributes:
        half_turn_s: time of a turn by half a circle
        burn_s: longest burn
        look_away_s: two half turns, and the burn between them
        period_s: from one burn decision to the next
        pace: period of the orbit over that of `inspection`
    """

    half_turn_s: float
    burn_s: float
    look_away_s: float
    period_s: float
    pace: float


_BASE_ORBIT_S, _BASE_PERIOD_S = 5677.0, 200.0
_MOST_OF_PERIOD = 0.55
"""Share of a burn period in which the camera looks away, as in `inspection`."""


def times_of(facts: MissionFacts, orbit_s: float) -> Times:
    """Times of turns, burns and burn periods on an orbit of a period [s]."""
    half_turn = _HALF_TURN_S * max(1.0, side_of_mass(facts.mass_kg) / _OF_SIDE_M)
    burn = min(max(_BURN_M_S * facts.mass_kg / facts.thrust_n, _BURN_S), _LONGEST_BURN_S)
    look_away = up_to(2.0 * half_turn + _SETTLE_S + burn + _MARGIN_S, 5.0)
    pace = orbit_s / _BASE_ORBIT_S
    period = up_to(max(look_away / _MOST_OF_PERIOD, _BASE_PERIOD_S), 20.0)
    return Times(half_turn, burn, look_away, period, pace)


def servicer_choices(facts: MissionFacts, times: Times) -> Choices:
    """Keys of the servicer's body, thruster, wheels and turns."""
    side = side_of_mass(facts.mass_kg)
    inertia = facts.mass_kg * side**2 / 6.0
    position = Choice(
        "dispersions",
        {"key": "thruster.position_m", "kind": "normal", "sigma": tidy_all([0.0, 0.0045 * side, 0.0045 * side])},
        "0.45 % of the side",
    )
    mass = Choice(
        "dispersions", {"key": "servicer.mass_kg", "kind": "normal", "sigma": tidy(0.01 * facts.mass_kg)}, "1 % of it"
    )
    return Choices(
        [
            *_body(facts, side, inertia),
            *_burns(facts, times, side),
            *_wheels(times, inertia),
            *_turns(times),
            Choice("rates.formation_period_s", times.period_s, _period_reason(times)),
        ],
        [mass, position],
    )


def servicer_area(facts: MissionFacts) -> float:
    """Mean cross-section of the servicer [m^2]: a quarter of the surface of its cube."""
    return 1.5 * side_of_mass(facts.mass_kg) ** 2


def _body(facts: MissionFacts, side: float, inertia: float) -> list[Choice]:
    return [
        Choice("servicer.mass_kg", facts.mass_kg),
        Choice(
            "servicer.inertia_kg_m2", tidy_all(inertia * _SHAPE), f"a cube of {side:.3g} m ({MASS_RULE}), a bit uneven"
        ),
        Choice(
            "servicer_surface.area_m2",
            tidy(servicer_area(facts)),
            f"a quarter of the surface of that cube, {side:.3g} m",
            True,
        ),
        Choice(
            "servicer_surface.center_of_pressure_m",
            tidy_all(np.array([0.022, 0.011, -0.011]) * side),
            f"2 and 1 % of {side:.3g} m",
            True,
        ),
    ]


def _burns(facts: MissionFacts, times: Times, side: float) -> list[Choice]:
    acceleration, nearest = facts.thrust_n / facts.mass_kg, facts.nearest_m
    allowed = nearest / _OF_LEAST_BURN / times.period_s
    on_time = tidy(min(max(allowed / acceleration, _LEAST_ON_TIME_S), _ON_TIME_S), 2)
    least = acceleration * on_time
    dead_band = max(nearest / _OF_DEAD_BAND / times.period_s, least)
    drift = f"{dead_band * times.period_s:.2g} m in a burn period, of {nearest:g} m"
    return [
        Choice("thruster.force_n", facts.thrust_n, f"{1e3 * acceleration:.3g} mm/s2"),
        Choice(
            "thruster.minimum_on_time_s", on_time, f"{1e3 * least:.2g} mm/s by {1e3 * acceleration:.3g} mm/s2, or less"
        ),
        Choice("thruster.position_m", tidy_all([-0.55 * side, 0.0, 0.0]), "aft face, by the centre of mass"),
        Choice("thruster.tank_position_m", tidy_all([-0.22 * side, 0.0, 0.0]), "before the thruster", True),
        Choice("formation.dead_band_mm_s", tidy(1e3 * dead_band, 2), f"{drift}; least burn {1e3 * least:.2g} mm/s"),
        Choice(
            "formation.lead_s",
            up_to(times.half_turn_s + _SETTLE_S + 0.5 * times.burn_s + _MARGIN_S, 1.0),
            f"half turn of {times.half_turn_s:.0f} s, settling, half the longest burn of {times.burn_s:.0f} s",
        ),
        Choice("limits.propellant_kg", tidy(0.1 * facts.mass_kg), "a tenth of the mass"),
    ]


def _wheels(times: Times, inertia: float) -> list[Choice]:
    largest = inertia * float(_SHAPE.max())
    acceleration = 2.0 * math.pi * math.pi / times.half_turn_s**2
    torque = tidy(1.5 * acceleration * largest, 2)
    rate = 2.0 * math.pi / times.half_turn_s
    momentum = 2.5 * largest * rate
    return [
        Choice(
            "wheels.inertia_kg_m2",
            [tidy(momentum / _WHEEL_SPEED_RAD_S)] * 3,
            f"{momentum:.2g} N m s at {_WHEEL_SPEED_RAD_S:g} rad/s: 2.5 times a half turn of {largest:.2g} kg m2",
        ),
        Choice(
            "wheels.torque_limit_n_m",
            [torque] * 3,
            f"1.5 times {largest:.2g} kg m2 by {1e3 * acceleration:.3g} mrad/s2",
        ),
        Choice("wheels.viscous_friction_n_m_s", [tidy(8e-5 * torque)] * 3, "5 % of the torque at full speed", True),
        Choice("wheels.coulomb_friction_n_m", [tidy(0.012 * torque)] * 3, "1.2 % of the torque", True),
        Choice("wheels.torque_step_n_m", tidy(8e-4 * torque), "12 bits over the torque range", True),
    ]


def _turns(times: Times) -> list[Choice]:
    slew = 1e3 * 2.0 * math.pi * math.pi / times.half_turn_s**2
    return [
        Choice("pointing.slew_acceleration_mrad_s2", tidy(slew), f"a half turn in {times.half_turn_s:.0f} s"),
        Choice("pointing.search_acceleration_mrad_s2", tidy(0.75 * slew), "three quarters of that"),
        Choice(
            "pointing.look_away_limit_s",
            times.look_away_s,
            f"two half turns of {times.half_turn_s:.0f} s, a burn of {times.burn_s:.0f} s, settling",
        ),
    ]


def _period_reason(times: Times) -> str:
    return f"{times.look_away_s:g} s of it may be out of sight"
