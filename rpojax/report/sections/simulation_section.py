"""What was simulated, in a few lines: runs, vehicle, orbit, camera, target and phases, as the scenario states them."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.report.campaign_results import CampaignResults, design_phrase, runs_are_independent
from rpojax.report.labels import format_number
from rpojax.scenario.numbers.key_units import unit_symbol
from rpojax.scenario.sections import NO_LANDMARKS

_EARTH_RADIUS_M: Final = 6378137.0
_MODELS: Final = {
    "geometric": "boxes by an error model, no images",
    "rendered": "rendered images and a detector",
    "statistical": "boxes by a model fitted to a detector",
}
_MOST_PHASES: Final = 6


def rows(campaign: CampaignResults, causes: Sequence[Mapping[str, Any]] = ()) -> list[tuple[str, str]]:
    """Title and text of each line, with the beliefs that `causes` of report.json name; empty lines are left out."""
    scenario = campaign.info.get("scenario", {})
    found = [
        ("Runs", _runs(campaign, scenario)),
        ("Vehicle", _vehicle(scenario, campaign.servicer_names)),
        ("Orbit", _orbit(scenario.get("orbit", {}))),
        ("Camera", _camera(scenario)),
        ("Target", _target(scenario.get("target", {}))),
        ("Mission", "; ".join(text for text in (_phases(scenario), _keep_out(scenario)) if text)),
        ("Believed", _believed(scenario, causes)),
    ]
    return [(title, text) for title, text in found if text]


def simulated_text(info: Mapping[str, Any], runs: int) -> str:
    """Number of runs, their duration and seed, as far as recorded."""
    duration = info.get("scenario", {}).get("duration_s")
    parts = [
        f"{runs} run" if runs == 1 else f"{runs} runs",
        f"{format_number(float(duration))} s each" if duration is not None else "",
        f"seed {info['seed']}" if "seed" in info else "",
    ]
    return ", ".join(part for part in parts if part)


def _runs(campaign: CampaignResults, scenario: Mapping[str, Any]) -> str:
    drawn = "each drawn by itself" if runs_are_independent(campaign) else f"drawn as {design_phrase(campaign)}"
    count = len(campaign.drawn)
    dispersed = f", {count} quantities dispersed" if count > 1 else ", 1 quantity dispersed" if count else ""
    return f"{drawn}{dispersed}" if scenario else ""


def _vehicle(scenario: Mapping[str, Any], names: Sequence[str]) -> str:
    mass, force = scenario.get("servicer", {}).get("mass_kg"), scenario.get("thruster", {}).get("force_n")
    wheels = scenario.get("wheels", {})
    parts = [] if mass is None else [f"{mass:g} kg"]
    parts += [] if force is None else [f"thruster of {force:g} N"]
    if small := [each["force_n"] for each in scenario.get("thrusters", [])]:
        least, most = (f"{value:g}" for value in (min(small), max(small)))
        parts.append(f"{len(small)} small ones of {least if least == most else f'{least} to {most}'} N")
    if {"inertia_kg_m2", "speed_limit_rad_s"} <= wheels.keys():
        momenta = np.multiply(wheels["inertia_kg_m2"], wheels["speed_limit_rad_s"])
        torques = wheels.get("torque_limit_n_m") or []
        torque = f" and {_ends(torques)} N m" if len(torques) else ""
        parts.append(f"{len(momenta)} wheels of {_ends(momenta)} N m s{torque}")
    team = f"{len(names)} servicers ({', '.join(names)}), " + ("each " if parts else "") if names else ""
    return team + ", ".join(parts)


def _orbit(orbit: Mapping[str, Any]) -> str:
    if "semi_major_axis_m" not in orbit:
        return ""
    altitude = (float(orbit["semi_major_axis_m"]) - _EARTH_RADIUS_M) / 1e3
    parts = [f"{altitude:.0f} km above the equator's radius"]
    for key, text in (("inclination_deg", "inclined by {:g} deg"), ("eccentricity", "eccentricity {:g}")):
        parts += [text.format(orbit[key])] if key in orbit else []
    return ", ".join(parts)


def _camera(scenario: Mapping[str, Any]) -> str:
    camera = scenario.get("camera", {})
    if "field_of_view_deg" not in camera:
        return ""
    size = f", {camera['width_px']} \N{MULTIPLICATION SIGN} {camera['height_px']} px" if "width_px" in camera else ""
    rate = scenario.get("rates", {}).get("camera_hz")
    model = _MODELS.get(str(camera.get("model")), "")
    lens = f"lens of {camera['field_of_view_deg']:g} deg (full angle){_wide_lens(scenario)}{size}"
    parts = [lens, f"{rate:g} Hz" if rate is not None else "", model]
    if camera.get("model") == "geometric" and {"miss_probability", "outlier_probability"} <= camera.keys():
        shares = (100.0 * float(camera[name]) for name in ("miss_probability", "outlier_probability"))
        parts.append("{:.3g} % missed and {:.3g} % false".format(*shares))
    if camera.get("landmarks", NO_LANDMARKS) != NO_LANDMARKS:
        parts.append("landmarks of the target by an error model")
    if reach_m := (scenario.get("lamp") or {}).get("reach_m"):
        parts.append(f"a lamp to {reach_m:g} m")
    return ", ".join(part for part in parts if part)


def _wide_lens(scenario: Mapping[str, Any]) -> str:
    lens = scenario.get("wide_lens") or {}
    if not {"field_of_view_deg", "switch_range_m"} <= lens.keys():
        return ""
    return f" and one of {lens['field_of_view_deg']:g} deg below {lens['switch_range_m']:g} m"


def _target(target: Mapping[str, Any]) -> str:
    parts = []
    if target.get("hull_m"):
        spans = np.ptp(np.asarray(target["hull_m"], dtype=float), axis=0) * float(target.get("scale", 1.0))
        parts.append(" \N{MULTIPLICATION SIGN} ".join(f"{span:.3g}" for span in spans) + " m")
    parts += [f"{target['mass_kg']:g} kg"] if "mass_kg" in target else []
    parts += [f"tumbles at {target['tumble_rate_deg_s']:g} deg/s"] if "tumble_rate_deg_s" in target else []
    return ", ".join(parts)


def _phases(scenario: Mapping[str, Any]) -> str:
    names = [str(phase.get("name", "")) for phase in scenario.get("phases") or []]
    if names:
        more = f" and {len(names) - _MOST_PHASES} more" if len(names) > _MOST_PHASES else ""
        return " \N{RIGHTWARDS ARROW} ".join(names[:_MOST_PHASES]) + more
    start = scenario.get("initial", {}).get("relative_position_m")
    station = scenario.get("formation", {}).get("desired_position_m")
    if start is None or station is None:
        return ""
    return f"from {_place(start)} to the station at {_place(station)}"


def _place(position: Sequence[float]) -> str:
    """A position in the Hill frame in words: what lies along one axis by its direction, else its components."""
    words = (("above", "below"), ("ahead", "behind"), ("north", "south"))
    along = [(value, word) for value, word in zip(position, words, strict=True) if value]
    if len(along) == 1:
        value, (positive, negative) = along[0]
        return f"{abs(value):g} m {positive if value > 0.0 else negative}"
    return f"({', '.join(f'{value:g}' for value in position)}) m"


def _keep_out(scenario: Mapping[str, Any]) -> str:
    radius = scenario.get("limits", {}).get("keep_out_m")
    return "" if radius is None else f"keep-out sphere of {radius:g} m about the target"


def _believed(scenario: Mapping[str, Any], causes: Sequence[Mapping[str, Any]]) -> str:
    """Beliefs of the filter that causes name, with their values."""
    names = [str(cause["title"]).rpartition("navigation.")[2] for cause in causes if cause["name"] == "belief"]
    believed = scenario.get("navigation", {})
    units = {name: unit_symbol(name) for name in names if isinstance(believed.get(name), int | float)}
    return ", ".join(f"{name} {believed[name]:g}{'' if unit == '1' else f' {unit}'}" for name, unit in units.items())


def _ends(values: Sequence[float] | np.ndarray) -> str:
    """The value of equal numbers, or the least and the greatest one."""
    low, high = (f"{value:.3g}" for value in (np.min(values), np.max(values)))
    return low if low == high else f"{low} to {high}"
