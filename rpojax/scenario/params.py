"""Parameters of a run: pytree of all numbers that can be dispersed or differentiated, and their scenario keys."""

import functools
import math
from collections.abc import Mapping
from dataclasses import field, fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.core.orbits.sun_moon_ephemeris import Epoch, epoch_at
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY
from rpojax.core.pytree import pytree, replace
from rpojax.dispersions.semidefinite_cholesky import cholesky_factor
from rpojax.errors import ScenarioError
from rpojax.flight.control.attitude_control import AttitudeControlTuning
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.cooperation.team_settings import BaselineTuning
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.navigation.attitude_ekf import AttitudeFilterTuning
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation_health import HealthTuning
from rpojax.flight.team_guidance.team_situation import TeamTuning
from rpojax.flight.vehicle_model import VehicleModel
from rpojax.physics import equipment_faults
from rpojax.physics.environment.drag import Atmosphere
from rpojax.physics.environment.solar_radiation_pressure import Sunlight
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.physics.equipment_faults import Fault
from rpojax.physics.plant_state import PlantParams, Target
from rpojax.physics.radio_link import RadioLink
from rpojax.physics.reaction_wheels import ReactionWheels
from rpojax.physics.rigid_body import Body
from rpojax.physics.thruster import Thruster
from rpojax.scenario import key_units, phase_table
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.start_and_limits import HandoverErrors, InitialRelativeState, Limits
from rpojax.scenario.trained import fitted_camera, trained_files
from rpojax.sensors.additional.registry import sensor_classes, sensor_names
from rpojax.sensors.camera import Camera
from rpojax.sensors.chamber_pressure import ChamberPressure
from rpojax.sensors.gps import Gps, GpsDifferences
from rpojax.sensors.gyro import Gyro
from rpojax.sensors.link_range import LinkRange
from rpojax.sensors.rendered_camera import Imaging, Networks
from rpojax.sensors.star_tracker import StarTracker
from rpojax.sensors.statistical_camera import CameraStatistics
from rpojax.value_types import epoch_seconds
from rpojax.vision import pinhole


@pytree
class Params:
    """All numbers of a run that can be dispersed or differentiated, SI and radians.

    `link`, `gps_differences`, `link_range`, `baseline` and `team` are used in a team of servicers; `epoch` has no key
    that can be dispersed.
    """

    orbit: KeplerianElements
    initial: InitialRelativeState
    plant: PlantParams
    gps: Gps
    star_tracker: StarTracker
    gyro: Gyro
    chamber_pressure: ChamberPressure
    camera: Camera
    imaging: Imaging
    networks: Networks | None
    statistics: CameraStatistics | None
    flight: FlightParams
    limits: Limits
    link: RadioLink
    gps_differences: GpsDifferences
    link_range: LinkRange
    baseline: BaselineTuning
    team: TeamTuning
    epoch: Epoch
    handover: HandoverErrors | None = None
    additional_sensors: dict[str, dict[str, Array]] = field(default_factory=dict)


_SECTIONS: dict[str, tuple[tuple[str, ...], type]] = {
    "orbit": (("orbit",), KeplerianElements),
    "initial": (("initial",), InitialRelativeState),
    "servicer": (("plant", "servicer"), Body),
    "target": (("plant", "target"), Target),
    "thruster": (("plant", "thruster"), Thruster),
    "wheels": (("plant", "wheels"), ReactionWheels),
    "servicer_surface": (("plant", "servicer_surface"), Surface),
    "target_surface": (("plant", "target_surface"), Surface),
    "atmosphere": (("plant", "atmosphere"), Atmosphere),
    "sunlight": (("plant", "sunlight"), Sunlight),
    "fault": (("plant", "fault"), Fault),
    "gps": (("gps",), Gps),
    "star_tracker": (("star_tracker",), StarTracker),
    "gyro": (("gyro",), Gyro),
    "chamber_pressure": (("chamber_pressure",), ChamberPressure),
    "camera": (("camera",), Camera),
    "imaging": (("imaging",), Imaging),
    "navigation": (("flight", "navigation"), OrbitFilterTuning),
    "attitude_filter": (("flight", "attitude_filter"), AttitudeFilterTuning),
    "formation": (("flight", "formation"), FormationTuning),
    "pointing": (("flight", "pointing"), PointingTuning),
    "attitude_control": (("flight", "attitude_control"), AttitudeControlTuning),
    "health": (("flight", "health"), HealthTuning),
    "limits": (("limits",), Limits),
}
"""Attribute path in `Params` and class of the record, by section of a scenario file."""
_TEAM_SECTIONS: dict[str, type] = {
    "link": RadioLink,
    "team": TeamTuning,
    "gps_differences": GpsDifferences,
    "link_range": LinkRange,
}
"""Class of the record, by section of a team; its name is that of the field of `Params`."""
_BELIEF_IN_DIFFERENCES = "navigation.difference_"
"""Begin of the keys of what flight software believes of differences of GPS positions and of ranges over links."""
_HANDOVER = "initial.handover"
"""Section that a scenario may leave out."""
_DETECTOR_CENTER = "imaging.center_sigma"
"""Key without unit of what flight software believes of a detector's boxes, declared beside the detector."""
_NOT_KEYS = frozenset({"detector_center_sigma", "detector_boxes", "burn_scale_as_new"})
"""Fields of the filter's tuning that are no keys of its section."""
_BURNS_WITH_THE_SAME_ERROR = 2.0
"""Factor on the sigma of a lasting error that counts as new in each burn: errors of several burns in one direction add
up, and do not average out."""


def build_params(tables: Mapping[str, Any], width_px: int, height_px: int) -> Params:
    """Parameters from the sections of a scenario; the flight software is configured with the nominal vehicle."""
    records = {
        section: section_record(cls, tables[section])
        for section, (_, cls) in _SECTIONS.items()
        if section != "navigation"
    }
    records["navigation"] = _navigation(tables)
    plant = PlantParams(
        gravity=jax.tree.map(_array, EARTH_GRAVITY),
        **{path[1]: records[name] for name, (path, _) in _SECTIONS.items() if path[0] == "plant"},
    )
    flight = FlightParams(
        vehicle=_nominal_vehicle(plant, records["camera"], width_px, height_px),
        **{
            name: records[name]
            for name in ("navigation", "attitude_filter", "formation", "pointing", "attitude_control", "health")
        },
        mission=phase_table.mission_tuning(tables),
        sensors=_sensor_numbers(tables, believed=True),
    )
    rest = ("orbit", "initial", "gps", "star_tracker", "gyro", "chamber_pressure", "camera", "imaging", "limits")
    return Params(
        epoch=epoch_at(epoch_seconds(tables["epoch_utc"])),
        plant=plant,
        flight=flight,
        networks=trained_files.networks_for_model(tables),
        statistics=fitted_camera.statistics_for_model(tables),
        handover=_handover_errors(tables["initial"].get("handover")),
        additional_sensors=_sensor_numbers(tables, believed=False),
        **{name: records[name] for name in rest},
        **_team_records(tables),
    )


def _team_records(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Links, differences of GPS positions and ranges as the truth has them, and what flight software believes."""
    outages = tables["link"]["outages_s"] or [[math.inf, math.inf]]
    starts, ends = map(_array, np.array(outages).T)
    prefix = _BELIEF_IN_DIFFERENCES.partition(".")[2]
    belief = {key.removeprefix(prefix): value for key, value in tables["navigation"].items() if key.startswith(prefix)}
    return {
        "link": RadioLink(outage_start=starts, outage_end=ends, **_fields(RadioLink, tables["link"])),
        "gps_differences": section_record(GpsDifferences, tables["gps_differences"]),
        "link_range": section_record(LinkRange, tables["link_range"]),
        "baseline": section_record(BaselineTuning, belief),
        "team": section_record(TeamTuning, tables["team"]),
    }


def section_record(cls: type, table: Mapping[str, Any]) -> Any:
    """Record of one section; keys without a field are static settings and are skipped."""
    return cls(**_fields(cls, table))


def _fields(cls: type, table: Mapping[str, Any]) -> dict[str, Array]:
    """Fields of a record that a section has, in SI and radians."""
    names = {field.name for field in fields(cls)}
    values = {}
    for key, value in table.items():
        name, factor = key_units.split_unit(key)
        if name in names:
            values[name] = _array(equipment_faults.kind_code(value), factor)
    return values


def _handover_errors(table: Mapping[str, Any] | None) -> HandoverErrors | None:
    if table is None:
        return None
    if "covariance" in table:
        return HandoverErrors(covariance_factor=_array(cholesky_factor(np.array(table["covariance"]))))
    return section_record(HandoverErrors, table)


def _numbers(table: Mapping[str, Any]) -> dict[str, Array]:
    """Numbers of a section in SI and radians, by name without unit."""
    units = {key: key_units.split_unit(key) for key in table}
    return {name: _array(table[key], factor) for key, (name, factor) in units.items()}


def _sensor_numbers(tables: Mapping[str, Any], believed: bool) -> dict[str, dict[str, Array]]:
    """Numbers of the additional sensors by name: those that flight software believes, or those of the truth."""
    found = {}
    for name, cls in plugin_registry.sensors_for(tables).items():
        if not believed or cls.is_believed():
            found[name] = _numbers(
                {key: value for key, value in tables[name].items() if (key in cls.beliefs) is believed}
            )
    return found


def _array(value: Any, factor: float = 1.0) -> Array:
    """A number or array in SI, without JAX, of which each operation would compile a program at the first start."""
    return jax.device_put(np.asarray(value, dtype=np.float64) * factor)


def _navigation(tables: Mapping[str, Any]) -> OrbitFilterTuning:
    """Filter tuning, with what it knows of detected boxes, and of burns where it has no state for their lasting error.

    What beliefs make together is worked out where they are used: each has a leaf of its own, which may be dispersed.
    """
    others = {
        "detector_center_sigma_m": tables["imaging"]["center_sigma_m"],
        "detector_boxes": float(tables["camera"]["model"] != "geometric"),
        "burn_scale_as_new": 0.0 if tables["navigation"]["sharing"] == "none" else _BURNS_WITH_THE_SAME_ERROR,
    }
    return section_record(OrbitFilterTuning, {**tables["navigation"], **others})


@jax.jit
def _normalized(vector: Array) -> Array:
    return vector / jnp.linalg.norm(vector)


@functools.partial(jax.jit, static_argnums=(1, 2))
def _focal_px(field_of_view: Array, width_px: int, height_px: int) -> Array:
    return pinhole.pinhole_intrinsics(field_of_view, width_px, height_px).focal_px


def _nominal_vehicle(plant: PlantParams, camera: Camera, width_px: int, height_px: int) -> VehicleModel:
    return VehicleModel(
        mass=plant.servicer.mass,
        inertia=plant.servicer.inertia,
        thrust=plant.thruster.force,
        minimum_on_time=plant.thruster.minimum_on_time,
        thrust_direction=_normalized(plant.thruster.direction),
        wheel_axes=plant.wheels.axes,
        wheel_inertia=plant.wheels.inertia,
        wheel_torque_limit=plant.wheels.torque_limit,
        camera_mounting=camera.mounting,
        focal_px=_focal_px(camera.field_of_view, width_px, height_px),
        phase_limit=camera.phase_limit,
        sun_exclusion=camera.sun_exclusion,
    )


def leaf_path_and_factor(key: str, params: Params | None = None) -> tuple[tuple[str, ...], float]:
    """Attribute path in `Params` of a key such as `servicer.mass_kg`, and the factor from its unit to SI.

    With `params` a sensor's key is a belief or not as in these, where classes of one name differ in what is believed.

    Raises:
        ScenarioError: the key names no number of a scenario.
    """
    section, _, name = key.rpartition(".")
    leaf, factor = key_units.split_unit(name)
    if f"{section}.{leaf}" == _DETECTOR_CENTER:
        return ("flight", "navigation", "detector_center_sigma"), factor
    if section in _SECTIONS or section == _HANDOVER:
        path, cls = _SECTIONS.get(section, (("handover",), HandoverErrors))
        if leaf in {field.name for field in fields(cls)} - _NOT_KEYS:
            return (*path, leaf), factor
    if section in _TEAM_SECTIONS and leaf in {field.name for field in fields(_TEAM_SECTIONS[section])}:
        return (section, leaf), factor
    if key.startswith(_BELIEF_IN_DIFFERENCES):
        return ("baseline", key_units.split_unit(key.removeprefix(_BELIEF_IN_DIFFERENCES))[0]), factor
    if key.split(".")[0] in ("phases", "mission"):
        return ("flight", "mission", *phase_table.leaf_path(key)), factor
    if section in sensor_names() and any(name in each.model_fields for each in sensor_classes(section)):
        is_belief = any(name in each.beliefs for each in sensor_classes(section))
        if params is not None:
            is_belief = leaf in params.flight.sensors.get(section, {})
        return (*(("flight", "sensors") if is_belief else ("additional_sensors",)), section, leaf), factor
    raise ScenarioError("key", key, "the key of a number in the scenario, such as 'servicer.mass_kg'")


def get_leaf(record: Any, path: tuple[str, ...]) -> Any:
    """Leaf of nested records at an attribute path."""
    return functools.reduce(
        lambda node, name: node[name] if isinstance(node, dict) else getattr(node, name), path, record
    )


def replace_leaf(record: Any, path: tuple[str, ...], value: Any) -> Any:
    """Copy of nested records with one leaf replaced."""
    head, *rest = path
    new = replace_leaf(get_leaf(record, (head,)), tuple(rest), value) if rest else value
    return {**record, head: new} if isinstance(record, dict) else replace(record, **{head: new})
