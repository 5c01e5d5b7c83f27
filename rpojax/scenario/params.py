"""Parameters of a run: pytree of all numbers that can be dispersed or differentiated, and their scenario keys."""

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, is_dataclass
from types import UnionType
from typing import Any, get_args, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.core.declared_numbers import declared_numbers
from rpojax.core.lamp import Lamp
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.core.orbits.sun_moon_ephemeris import Epoch, epoch_at
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY
from rpojax.core.pytree import pytree, replace, select
from rpojax.dispersions.semidefinite_cholesky import cholesky_factor
from rpojax.errors import ScenarioError
from rpojax.flight.computer import LANDMARKS
from rpojax.flight.control import thruster_allocation
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.control.thruster_allocation import ThrusterLayout
from rpojax.flight.cooperation.team_settings import BaselineTuning
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance.lens_choice import BelievedWideLens, LensInUse
from rpojax.flight.navigation import symmetric_attitudes
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget
from rpojax.flight.team_guidance.team_situation import TeamTuning
from rpojax.flight.vehicle_model import VehicleModel
from rpojax.physics import hull_distance, plume_impingement
from rpojax.physics.equipment_faults import Fault
from rpojax.physics.hull_distance import HullFaces
from rpojax.physics.plant_state import PlantParams
from rpojax.physics.plume_impingement import Facets
from rpojax.physics.radio_link import RadioLink
from rpojax.physics.rcs_thrusters import RcsThruster
from rpojax.scenario import mission_from_phases
from rpojax.scenario.numbers import key_units
from rpojax.scenario.numbers.section_records import array, record_of, section_record
from rpojax.scenario.numbers.start_and_limits import HandoverErrors, InitialRelativeState, Limits
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.trained import coverage_surface, fitted_camera, ranging_surface, target_landmarks, trained_files
from rpojax.sensors.additional import surface_ranging
from rpojax.sensors.additional.registry import sensor_classes, sensor_names
from rpojax.sensors.additional.surface_ranging import TargetSurface
from rpojax.sensors.camera import Camera, WideLens, through_wide
from rpojax.sensors.chamber_pressure import ChamberPressure
from rpojax.sensors.gps import Gps, GpsDifferences
from rpojax.sensors.gyro import Gyro
from rpojax.sensors.imaging import Imaging
from rpojax.sensors.link_range import LinkRange
from rpojax.sensors.measurement_delay import MeasurementDelay
from rpojax.sensors.rendered_camera import Networks
from rpojax.sensors.star_tracker import StarTracker
from rpojax.sensors.statistical_camera import CameraStatistics
from rpojax.value_types import epoch_seconds
from rpojax.vision import pinhole
from rpojax.vision.surface.landmarks import Landmarks


@pytree
class Params:
    """All numbers of a run that can be dispersed or differentiated, SI and radians.

    `link`, `gps_differences`, `link_range`, `baseline` and `team` are used in a team of servicers; `epoch` has no key
    that can be dispersed. `surface` and `landmarks` are those of the target, where a sensor meets or finds them.
    """

    orbit: KeplerianElements
    initial: InitialRelativeState
    plant: PlantParams
    gps: Gps
    star_tracker: StarTracker
    gyro: Gyro
    chamber_pressure: ChamberPressure
    camera: Camera
    camera_delay: MeasurementDelay
    imaging: Imaging
    networks: Networks | None
    statistics: CameraStatistics | None
    lamp: Lamp | None
    wide_lens: WideLens | None
    wide_statistics: CameraStatistics | None
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
    surface: TargetSurface | None = None
    landmarks: Landmarks | None = None

    @property
    def mesh_offset(self) -> Float[Array, "3"]:
        """Place of the origin of the target's mesh from its centre of mass, which landmarks tell, in T [m]."""
        sensor = self.additional_sensors.get(LANDMARKS)
        return jnp.zeros(3) if sensor is None else sensor["body_offset"]

    def seen_through(self, lens: LensInUse | None) -> "Params":
        """The same with camera and beliefs of the lens in use, None without a second one."""
        if self.wide_lens is None or lens is None:
            return self
        statistics = self.statistics
        if statistics is not None and self.wide_statistics is not None:
            statistics = select(lens.is_wide, self.wide_statistics, statistics)
        return replace(
            self,
            camera=through_wide(self.camera, self.wide_lens, lens.is_wide),
            statistics=statistics,
            flight=self.flight.seen_through(lens),
        )

    def with_steps(self) -> "Params":
        """The same with gates and dead band as the steps that they are in derivatives, too; no value depends on it."""
        steps = array(math.inf)
        navigation = replace(self.flight.navigation, gate_slope_width=steps)
        formation = replace(self.flight.formation, dead_band_slope=steps)
        return replace(self, flight=replace(self.flight, navigation=navigation, formation=formation))


_HANDOVER = "initial.handover"
"""Section that a scenario may leave out."""
_GATE_SLOPE_WIDTH = 0.25
"""Width of the slope of gates in derivatives [squared sigmas] (experiments/tuning)."""
_DEAD_BAND_SLOPE = 0.05
"""Width of that of the dead band over the band [-]."""
_BURNS_WITH_THE_SAME_ERROR = 2.0
"""Factor on the sigma of a lasting error that counts as new in each burn: errors of several burns in one direction add
up, and do not average out."""


def build_params(tables: Mapping[str, Any], width_px: int, height_px: int) -> Params:
    """Parameters from the sections of a scenario; the flight software is configured with the nominal vehicle."""
    thrusters = {each["name"]: section_record(RcsThruster, each) for each in tables["thrusters"]}
    faults = {each["name"]: section_record(Fault, each) for each in tables["faults"]}
    plant = PlantParams(
        gravity=jax.tree.map(array, EARTH_GRAVITY),
        faults=faults,
        thrusters=thrusters,
        facets=_facets(tables),
        hull_faces=_hull_faces(tables),
        **_records(PlantParams, tables),
    )
    outages = tables["link"]["outages_s"] or [[math.inf, math.inf]]
    starts, ends = map(array, np.array(outages).T)
    rest = _records(Params, tables, without=("link",))
    lamp, wide = tables.get("lamp"), tables.get("wide_lens")
    lamp = None if lamp is None else section_record(Lamp, lamp)
    landmarks = target_landmarks.landmarks_for_camera(tables)
    flight = FlightParams(
        vehicle=replace(
            _nominal_vehicle(plant, rest["camera"], width_px, height_px),
            dark_reach=_reach_without_light(tables),
            lamp=lamp,
        ),
        navigation=_navigation(tables),
        mission=mission_from_phases.mission_tuning(tables),
        atmosphere=plant.atmosphere,
        sensors=_sensor_numbers(tables, believed=True),
        thrusters=_nominal_thrusters(tables["thrusters"]) if thrusters else None,
        wide_lens=None if wide is None else _believed_wide_lens(tables, width_px, height_px),
        target=None if landmarks is None else _believed_target(tables, landmarks),
        formation=record_of(FormationTuning, tables, "formation", dead_band_slope=array(_DEAD_BAND_SLOPE)),
        **_records(FlightParams, tables, without=("navigation", "mission", "atmosphere", "formation")),
    )
    return Params(
        epoch=epoch_at(epoch_seconds(tables["epoch_utc"])),
        plant=plant,
        flight=flight,
        networks=trained_files.networks_for_model(tables, landmarks),
        statistics=fitted_camera.statistics_for_model(tables),
        lamp=lamp,
        wide_lens=None if wide is None else section_record(WideLens, wide),
        wide_statistics=fitted_camera.wide_statistics_for_model(tables),
        handover=_handover_errors(tables["initial"].get("handover")),
        link=section_record(RadioLink, tables["link"], outage_start=starts, outage_end=ends),
        additional_sensors=_sensor_numbers(tables, believed=False),
        surface=ranging_surface.surface_for_sensors(tables),
        landmarks=landmarks,
        **rest,
    )


def _records(parent: type, tables: Mapping[str, Any], without: tuple[str, ...] = ()) -> dict[str, Any]:
    """Fields of a record that are records of declared numbers, from the sections of their names."""
    return {
        name: record_of(cls, tables, name)
        for name, cls in get_type_hints(parent).items()
        if isinstance(cls, type) and is_dataclass(cls) and declared_numbers(cls) and name not in without
    }


def _facets(tables: Mapping[str, Any]) -> Facets | None:
    """Facets of the target's hull, None unless plumes push it."""
    if not tables["effects"]["plume"]:
        return None
    return plume_impingement.facets_of(coverage_surface.hull_triangles(np.array(tables["target"]["hull_m"])))


def _handover_errors(table: Mapping[str, Any] | None) -> HandoverErrors | None:
    if table is None:
        return None
    if "covariance" in table:
        return HandoverErrors(covariance_factor=array(cholesky_factor(np.array(table["covariance"]))))
    return record_of(HandoverErrors, {_HANDOVER: table}, _HANDOVER)


def _numbers(table: Mapping[str, Any]) -> dict[str, Array]:
    """Numbers of a section in SI and radians, by name without unit."""
    units = {key: key_units.split_unit(key) for key in table}
    return {name: array(table[key], factor) for key, (name, factor) in units.items()}


def _sensor_numbers(tables: Mapping[str, Any], believed: bool) -> dict[str, dict[str, Array]]:
    """Numbers of the additional sensors by name: those that flight software believes, or those of the truth."""
    found = {}
    for name, cls in plugin_registry.sensors_for(tables).items():
        if not believed or cls.is_believed():
            found[name] = _numbers(
                {key: value for key, value in tables[name].items() if (key in cls.beliefs) is believed}
            )
    return found


def _navigation(tables: Mapping[str, Any]) -> OrbitFilterTuning:
    """Filter tuning, with what it knows of detected boxes, and of burns where it has no state for their lasting error.

    What beliefs make together is worked out where they are used: each has a leaf of its own, which may be dispersed.
    """
    as_new = 0.0 if tables["navigation"]["sharing"] == "none" else _BURNS_WITH_THE_SAME_ERROR
    return record_of(
        OrbitFilterTuning,
        tables,
        "navigation",
        detector_boxes=array(float(tables["camera"]["model"] != "geometric")),
        burn_scale_as_new=array(as_new),
        gate_slope_width=array(_GATE_SLOPE_WIDTH),
    )


@jax.jit
def _normalized(vector: Array) -> Array:
    return vector / jnp.linalg.norm(vector)


@functools.partial(jax.jit, static_argnums=(1, 2))
def _focal_px(field_of_view: Array, width_px: int, height_px: int) -> Array:
    return pinhole.pinhole_intrinsics(field_of_view, width_px, height_px).focal_px


def _nominal_thrusters(tables: Sequence[Mapping[str, Any]]) -> ThrusterLayout:
    """The thrusters as flight software believes them: nominal, in the order of their names."""
    named = sorted(tables, key=lambda table: table["name"])
    force, isp, minimum_on, direction, position = (
        np.array([table[key] for table in named], dtype=np.float64)
        for key in ("force_n", "isp_s", "minimum_on_s", "direction", "position_m")
    )
    wrench = thruster_allocation.wrench_matrix(force, direction, position)
    return thruster_allocation.layout(wrench, force / (isp * STANDARD_GRAVITY), minimum_on)


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
        distortion=camera.distortion,
    )


def _believed_wide_lens(tables: Mapping[str, Any], width_px: int, height_px: int) -> BelievedWideLens:
    lens = section_record(WideLens, tables["wide_lens"])
    focal_px = _focal_px(lens.field_of_view, width_px, height_px)
    return record_of(BelievedWideLens, tables, "wide_lens", focal_px=focal_px, distortion=lens.distortion)


def _hull_faces(tables: Mapping[str, Any]) -> HullFaces | None:
    """Faces of the target's hull, None where no phase is in the frame of the target."""
    if all(phase.get("frame") != "target" for phase in tables["phases"] or []):
        return None
    return hull_distance.faces_of(np.asarray(tables["target"]["hull_m"], dtype=np.float64))


def _believed_target(tables: Mapping[str, Any], landmarks: Landmarks) -> BelievedTarget:
    """The nominal target, of the size that flight software believes."""
    symmetries = symmetric_attitudes.of_body(landmarks.symmetries, landmarks.shifts, landmarks.permutations)
    inertia = array(tables["target"]["inertia_kg_m2"])
    return BelievedTarget(inertia=inertia, landmarks=landmarks.positions, symmetries=symmetries)


def _reach_without_light(tables: Mapping[str, Any]) -> Array | None:
    """Range at which the nominal LiDAR sees a grey surface askew, None without one that the filter believes."""
    section = tables.get("lidar")
    return None if section is None else array(section["maximum_range_m"] * surface_ranging.TYPICAL_REACH)


def leaf_path_and_factor(key: str, params: Params | None = None) -> tuple[tuple[str, ...], float]:
    """Attribute path in `Params` of a key such as `servicer.mass_kg`, and the factor from its unit to SI.

    With `params` a sensor's key is a belief or not as in these, where classes of one name differ in what is believed.

    Raises:
        ScenarioError: the key names no number of a scenario.
    """
    if key in (leaves := declared_leaves(Params)):
        return leaves[key]
    section, _, name = key.rpartition(".")
    leaf, factor = key_units.split_unit(name)
    if section.startswith(("thrusters.", "faults.")):
        return ("plant", *section.split(".", 1), leaf), factor
    if key.split(".")[0] in ("phases", "mission"):
        return ("flight", "mission", *mission_from_phases.leaf_path(key)), factor
    if section in sensor_names() and any(name in each.model_fields for each in sensor_classes(section)):
        is_belief = any(name in each.beliefs for each in sensor_classes(section))
        if params is not None:
            is_belief = leaf in params.flight.sensors.get(section, {})
        return (*(("flight", "sensors") if is_belief else ("additional_sensors",)), section, leaf), factor
    raise ScenarioError("key", key, "the key of a number in the scenario, such as 'servicer.mass_kg'")


@functools.cache
def declared_leaves(whole: type) -> dict[str, tuple[tuple[str, ...], float]]:
    """Attribute path in a record of records, and factor to SI, of each number by its key with and without the unit.

    The section of a number is named like the field that holds its record, unless its declaration names another one. Of
    two records under one name the first is that of the scenario; a later one is a copy, such as a belief.
    """
    found: dict[str, tuple[tuple[str, ...], float]] = {}
    for path, cls in _records_below(whole):
        for name, (key, _) in declared_numbers(cls).items():
            full = key if "." in key else f"{path[-1]}.{key}"
            bare, factor = key_units.split_unit(full)
            found = {bare: ((*path, name), 1.0), full: ((*path, name), factor)} | found
    return found


def _records_below(cls: type, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], type]]:
    """A record and all that it holds, each with its attribute path."""
    yield path, cls
    for name, hint in get_type_hints(cls).items():
        for each in get_args(hint) if isinstance(hint, UnionType) else (hint,):
            if isinstance(each, type) and is_dataclass(each):
                yield from _records_below(each, (*path, name))


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
