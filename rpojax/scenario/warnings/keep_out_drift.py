"""Whether the servicer drifts into the keep-out sphere of its target between two burns."""

import numpy as np

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.nominal_motion import mean_motion, transition_matrices

_INSTANTS = 61


def keep_out_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Start and station from which the free motion of a burn period enters the keep-out sphere."""
    period, n = file.rates.formation_period_s, mean_motion(file)
    keep_out = reach.high("limits.keep_out_m")
    station = reach.axis_extremes("formation.desired_position_m")
    states = {
        "initial.relative_position_m": reach.axis_extremes(
            "initial.relative_position_m", "initial.relative_velocity_m_s"
        ),
        "formation.desired_position_m": np.concatenate([station, np.zeros_like(station)], axis=1),
    }
    # The first burn follows the first decision; later ones are a period apart.
    spans = {"initial.relative_position_m": reach.high("formation.lead_s"), "formation.desired_position_m": period}
    found = []
    for key, cases in states.items():
        motion = transition_matrices(n, np.linspace(0.0, spans[key], _INSTANTS))
        least = float(np.linalg.norm(np.einsum("tij,cj->tci", motion[:, :3], cases), axis=2).min())
        if least <= keep_out:
            place = "start" if key.startswith("initial") else "station"
            found.append(
                f"{key}: the servicer drifts from the {place} to {least:.3g} m in the {spans[key]:g} s until a burn, "
                f"expected above limits.keep_out_m = {keep_out:g}"
            )
    return found
