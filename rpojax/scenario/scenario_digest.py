"""Hash of a scenario, by which campaigns of the same runs are recognised."""

import hashlib
import json
from typing import Any

from rpojax.scenario import former_fault
from rpojax.scenario.measurement_delays import KEYS as DELAY_KEYS
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained import coverage_surface, target_landmarks, trained_files
from rpojax.sensors.additional.registry import sensor_names
from rpojax.value_types import Section


def scenario_digest(file: ScenarioFile) -> str:
    """SHA-256 of everything in a scenario that can change a number of a run, trained files included.

    Name, description, limits of requirements and the weights of tuning cannot; metrics in windows are stored.
    """
    content = file.model_dump(mode="json", exclude={"name", "description", "requirements", "tuning", "start"})
    if file.design.kind == "independent":
        del content["design"]
    elif file.design.kind == "grid":
        # The order of the keys decides which run has which combination.
        content["design"]["values"] = list(content["design"]["values"].items())
    # Campaigns recorded before these keys existed keep their digest.
    if file.precision == "double":
        del content["precision"]
    del content["format_version"]
    content.pop("plugin", None)  # where it is; its hash counts
    for name in ("phases", "servicers", "thrusters"):
        if not content[name]:
            del content[name]
    for name in set(content) & set(sensor_names()):
        for key in DELAY_KEYS:
            if not content[name].get(key):
                content[name].pop(key, None)
    for phase in content.get("phases", ()):
        if phase["control"] == "burns":
            del phase["control"]
        if phase["frame"] == "hill":
            del phase["frame"]
    content = former_fault.as_formerly(content)
    _remove_defaults(file, content)
    # Before this key existed, the pressure was measured where equipment could fail.
    if (measured := file.chamber_pressure.enabled) != file.effects.faults:
        content.setdefault("chamber_pressure", {})["enabled"] = measured
    elif content.get("chamber_pressure", {}).pop("enabled", None) and not content["chamber_pressure"]:
        del content["chamber_pressure"]
    if windows := sorted({each.metric_name for each in file.requirements if each.window.suffix}):
        content["metrics_in_windows"] = windows
    if trained := trained_files.required_digests(content):
        content["trained"] = trained
    if landmarks := target_landmarks.landmark_path(content):
        content["landmarks_sha256"] = trained_files.file_digest(landmarks)
    if not file.coverage.enabled:
        coverage = content.pop("coverage", {})
        if coverage_surface.is_surface_used(content):
            content["coverage"] = {key: coverage[key] for key in ("surface", "mesh_units") if key in coverage}
    if mesh := coverage_surface.mesh_digest(content):
        content["mesh"] = mesh
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _remove_defaults(file: ScenarioFile, content: dict[str, Any]) -> None:
    """Removes from the tables of `content` the keys that have a default and its value, and tables thus empty."""
    for name in set(content) - {"design", "fault", "faults", "phases", "servicers", "thrusters", *sensor_names()}:
        section = getattr(file, name)
        if not isinstance(section, Section):
            continue
        for key, field in type(section).model_fields.items():
            if not field.is_required() and getattr(section, key) == field.get_default():
                content[name].pop(key, None)
        if not content[name]:
            del content[name]
