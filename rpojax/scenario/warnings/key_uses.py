"""Under which conditions keys of a scenario have an effect: one table of those that some scenarios do without.

A key may stand in several rows, of which all must hold; one that stands in none always has an effect. Where a condition
does not hold, the compiled program does not read the parameter, or multiplies it by zero.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from rpojax.core.declared_numbers import declared_numbers
from rpojax.physics.plume_impingement import Plume
from rpojax.scenario.measurement_delays import KEYS as DELAY_KEYS
from rpojax.scenario.measurement_delays import delay_settings
from rpojax.scenario.phases.phase_sections import PhaseSection
from rpojax.scenario.phases.reference_sections import RelativeOrbitSection, TransferSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained.coverage_surface import SURFACES, is_surface_used
from rpojax.scenario.trained.target_landmarks import landmarks_for_camera
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.value_types import Section

_WITHOUT_BURSTS_S: Final = 1e9
"""Mean time between bursts of losses that stands for none [s]."""


@dataclass(frozen=True)
class Situation:
    """What decides about uses: the scenario of one servicer, and what its numbers reach over the runs.

    Attributes:
        file: scenario of a servicer, which may be one of a team
        is_of_team: whether it is
        replaced: names of the stages of the flight software that are not the packaged ones
    """

    file: ScenarioFile
    is_of_team: bool
    replaced: frozenset[str] = frozenset()

    @cached_property
    def reach(self) -> DispersedReach:
        """Ends of all numbers over the runs."""
        return DispersedReach(self.file)

    @property
    def sharing(self) -> str:
        """What the servicers share, `none` without a team."""
        return self.file.navigation.sharing

    @cached_property
    def fault_kinds(self) -> set[str]:
        """Kinds of fault of the runs, without `none`; empty where faults are off."""
        return self.reach.fault_kinds - {"none"} if self.file.effects.faults else set()

    def kinds_of(self, fault: str) -> set[str]:
        """Kinds that the fault of a name may be of, without `none`."""
        return self.reach.kinds_of(fault) - {"none"}

    @property
    def can_hold(self) -> bool:
        """Whether a mission of phases may come to hold its place, by command or after a timeout."""
        waits = any(phase.timeout_s is not None and phase.on_timeout == "hold" for phase in self.file.phases)
        return waits or (self.holds_by_command and not self.ends_before("mission.hold_at_s"))

    @property
    def holds_by_command(self) -> bool:
        """Whether the command to hold comes before those that end what it begins: to resume, and to abort."""
        ends = min(self.reach.high("mission.resume_at_s"), self.reach.high("mission.abort_at_s"))
        return self.reach.low("mission.hold_at_s") < ends

    def ends_before(self, key: str) -> bool:
        """Whether all runs end before the time of a key."""
        return self.reach.low(key) >= self.file.duration_s

    def can_differ_from_zero(self, key: str) -> bool:
        """Whether a number is not zero in all runs."""
        return bool(self.reach.ends(key).any())


@dataclass(frozen=True)
class Use:
    """Condition under which keys have an effect.

    Attributes:
        keys: of sections; `SECTION.*` stands for all of one
        needs: what makes it hold, as a warning and the reference say it
        holds: the condition
    """

    keys: tuple[str, ...]
    needs: str
    holds: Callable[[Situation], bool]


@dataclass(frozen=True)
class PhaseUse:
    """The same, of keys of a phase.

    Attributes:
        keys: without `phases.NAME.`
        needs: what makes it hold
        holds: the condition
    """

    keys: tuple[str, ...]
    needs: str
    holds: Callable[[Situation, PhaseSection], bool]


@dataclass(frozen=True)
class FaultUse:
    """The same, of keys of a fault.

    Attributes:
        keys: without `faults.NAME.`
        needs: what makes it hold
        holds: the condition, of the situation and the name of the fault
    """

    keys: tuple[str, ...]
    needs: str
    holds: Callable[[Situation, str], bool]


def _surfaces(*names: str) -> tuple[str, ...]:
    return tuple(f"{section}.{name}" for section in ("servicer_surface", "target_surface") for name in names)


def _looks_alike_in_other_attitudes(at: Situation) -> bool:
    """Whether the target has a symmetry, by which its landmarks can be exchanged."""
    landmarks = landmarks_for_camera(at.file.model_dump())
    return landmarks is not None and landmarks.symmetries.shape[0] > 1


_PLANT: Final = (
    Use(("atmosphere.*", *_surfaces("drag_coefficient")), "effects.drag = true", lambda at: at.file.effects.drag),
    Use(
        ("sunlight.*", *_surfaces("pressure_coefficient")),
        "effects.solar_pressure = true",
        lambda at: at.file.effects.solar_pressure,
    ),
    Use(
        _surfaces("area_m2", "center_of_pressure_m"),
        "effects.drag or effects.solar_pressure = true",
        lambda at: at.file.effects.drag or at.file.effects.solar_pressure,
    ),
    Use(
        ("target.mass_kg",),
        "effects.drag, effects.solar_pressure or effects.plume = true",
        lambda at: at.file.effects.drag or at.file.effects.solar_pressure or at.file.effects.plume,
    ),
    Use(
        tuple(f"plume.{key}" for key, _ in declared_numbers(Plume).values()),
        "effects.plume = true",
        lambda at: at.file.effects.plume,
    ),
    Use(("plume.inhibit_within_m",), "[[thrusters]]", lambda at: bool(at.file.thrusters)),
    Use(
        ("plume.inhibit_angle_deg",),
        "[[thrusters]] and a plume.inhibit_within_m above 0",
        lambda at: bool(at.file.thrusters) and at.can_differ_from_zero("plume.inhibit_within_m"),
    ),
    Use(
        ("target.tumble_axis",),
        "a target.tumble_rate_deg_s other than 0",
        lambda at: at.can_differ_from_zero("target.tumble_rate_deg_s"),
    ),
    Use(
        ("wheels.viscous_friction_n_m_s", "wheels.coulomb_friction_n_m"),
        "effects.wheel_friction = true",
        lambda at: at.file.effects.wheel_friction,
    ),
    Use(
        ("wheels.stiction_speed_rad_s",),
        "effects.wheel_friction = true or a fault of that kind",
        lambda at: at.file.effects.wheel_friction or "wheel_friction" in at.fault_kinds,
    ),
    Use(
        ("wheels.torque_step_n_m",), "effects.wheel_torque_steps = true", lambda at: at.file.effects.wheel_torque_steps
    ),
    Use(
        ("thruster.rise_time_s", "thruster.fall_time_s"),
        "effects.thruster_ramps = true",
        lambda at: at.file.effects.thruster_ramps,
    ),
    Use(
        ("thruster.tank_position_m",),
        "effects.center_of_mass_shift = true",
        lambda at: at.file.effects.center_of_mass_shift,
    ),
    Use(("thruster.tank_radius_m",), "effects.inertia_change = true", lambda at: at.file.effects.inertia_change),
)

_CAMERA: Final = (
    Use(
        (
            "camera.edge_noise_px",
            "camera.miss_probability",
            "camera.minimum_size_px",
            "camera.outlier_probability",
            "camera.outlier_size_min_px",
            "camera.outlier_size_max_px",
        ),
        "camera.model = 'geometric'",
        lambda at: at.file.camera.model == "geometric",
    ),
    Use(
        ("camera.outlier_size_min_px", "camera.outlier_size_max_px"),
        "a camera.outlier_probability above 0",
        lambda at: at.can_differ_from_zero("camera.outlier_probability"),
    ),
    # The statistics must have been fitted to the pictures of field, detector and settings: they are compared.
    Use(
        ("imaging.*",),
        "camera.model = 'rendered' or 'statistical'",
        lambda at: at.file.camera.model != "geometric",
    ),
    Use(("wide_lens.edge_noise_px",), "camera.model = 'geometric'", lambda at: at.file.camera.model == "geometric"),
    Use(("wide_lens.statistics",), "camera.model = 'statistical'", lambda at: at.file.camera.model == "statistical"),
    Use(("imaging.bloom_radius_px",), "imaging.bloom", lambda at: at.file.imaging.bloom is not None),
    Use(("imaging.sky_seed",), "camera.model = 'rendered'", lambda at: at.file.camera.model == "rendered"),
    Use(
        ("imaging.landmark_network",),
        "camera.landmarks of camera.model = 'rendered' or 'statistical'",
        lambda at: at.file.camera.model != "geometric" and at.file.landmarks is not None,
    ),
    Use(("imaging.statistics",), "camera.model = 'statistical'", lambda at: at.file.camera.model == "statistical"),
    Use(
        (
            "coverage.facet_size_m",
            "coverage.incidence_limit_deg",
            "coverage.sun_incidence_limit_deg",
            "coverage.resolution_limit_m_px",
            "coverage.spacing_s",
        ),
        "coverage.enabled = true",
        lambda at: at.file.coverage.enabled,
    ),
    Use(
        ("coverage.surface", "coverage.mesh_units"),
        "coverage.enabled = true, or a range finder or LiDAR",
        lambda at: is_surface_used(at.file.model_dump()),
    ),
    Use(
        ("coverage.mesh_units",),
        "a mesh file as coverage.surface",
        lambda at: at.file.coverage.surface not in SURFACES,
    ),
    Use(("servicer.radius_m",), 'a last phase with frame = "target"', lambda at: at.file.ends_at_port),
    Use(
        (
            "landmarks.noise_px",
            "landmarks.shaded_noise_px",
            "landmarks.miss_probability",
            "landmarks.shaded_miss_probability",
            "landmarks.outlier_probability",
            "landmarks.minimum_size_px",
        ),
        "camera.model = 'geometric': with others they are those that a network finds, or its statistics",
        lambda at: at.file.camera.model == "geometric",
    ),
    Use(
        ("landmarks.swap_probability",),
        "landmarks of a body with a symmetry, and camera.model = 'geometric'",
        lambda at: (
            at.file.landmarks is None or (at.file.camera.model == "geometric" and _looks_alike_in_other_attitudes(at))
        ),
    ),
)


def _is_late(sensor: str) -> Callable[[Situation], bool]:
    def holds(at: Situation) -> bool:
        delays = delay_settings(at.file)
        return delays is not None and sensor in delays.sensors

    return holds


_DELAYS: Final = (
    *(
        Use(tuple(f"{sensor}.{key}" for key in DELAY_KEYS), f"one of these keys of {sensor} beside 0", _is_late(sensor))
        for sensor in ("camera", "range_finder", "lidar", "landmarks")
    ),
    Use(
        ("navigation.delays", "navigation.delay_memory_s"),
        "late measurements, such as by camera.delay_s",
        lambda at: delay_settings(at.file) is not None,
    ),
)

_FLIGHT: Final = (
    Use(
        ("navigation.nearest_surface", "navigation.nearest_surface_sigma"),
        "a section range_finder",
        lambda at: at.file.range_finder is not None,
    ),
    Use(
        ("navigation.centroid", "navigation.centroid_sigma"),
        "a section lidar",
        lambda at: at.file.lidar is not None,
    ),
    Use(
        (
            "navigation.tumble_sigma_deg_s",
            "navigation.tumble_walk_deg_s_sqrt_s",
            "navigation.inertia_ratio_sigma",
            "navigation.body_offset_sigma_m",
        ),
        "camera.landmarks",
        lambda at: at.file.landmarks is not None,
    ),
    Use(
        (
            "navigation.network_turn_sigma_deg",
            "navigation.network_place_sigma",
            "navigation.network_angle_deg",
        ),
        "camera.landmarks of camera.model = 'rendered' or 'statistical'",
        lambda at: at.file.landmarks is not None and at.file.camera.model != "geometric",
    ),
    Use(
        ("isolation.*",),
        "isolation.enabled and chamber_pressure.enabled = true with [[thrusters]]",
        lambda at: at.file.isolates_thrusters,
    ),
    Use(
        (
            "chamber_pressure.noise",
            "navigation.thrust_sigma",
            "navigation.thrust_walk_sqrt_s",
            "navigation.pressure_noise",
            "formation.thruster_retry_s",
        ),
        "chamber_pressure.enabled = true",
        lambda at: at.file.chamber_pressure.enabled,
    ),
    Use(
        (
            "navigation.gate_sigma",
            "navigation.confirm_tolerance_deg_s",
            "navigation.confirm_within_s",
            "navigation.recovery_after_s",
            "navigation.recovery_position_sigma",
            "navigation.recovery_velocity_sigma_m_s",
            "health.contradiction_limit",
        ),
        "navigation.gating = 'covariance'",
        lambda at: at.file.navigation.gating == "covariance",
    ),
    # Pictures and fitted statistics are those for the ranges of start and station.
    Use(
        ("formation.desired_position_m",),
        "no [[phases]]",
        lambda at: not at.file.phases or at.file.camera.model != "geometric",
    ),
    Use(
        ("health.clearance",),
        "no [[phases]]",
        lambda at: not at.file.phases,
    ),
    Use(
        ("gps.bias_time_constant_s",),
        "a gps.bias_sigma_m above 0",
        lambda at: at.can_differ_from_zero("gps.bias_sigma_m"),
    ),
    *(
        Use((key,), "a longer duration_s", lambda at, key=key: not at.file.phases or not at.ends_before(key))
        for key in ("mission.hold_at_s", "mission.resume_at_s", "mission.abort_at_s")
    ),
    Use(
        ("mission.hold_at_s",),
        "a later mission.resume_at_s and mission.abort_at_s",
        lambda at: at.holds_by_command,
    ),
    Use(
        ("mission.resume_at_s",),
        "mission.hold_at_s or a phase with on_timeout = 'hold'",
        lambda at: not at.file.phases or at.can_hold,
    ),
    Use(
        ("mission.resume_at_s",),
        "a later mission.abort_at_s",
        lambda at: at.reach.low("mission.resume_at_s") < at.reach.high("mission.abort_at_s"),
    ),
)

_TEAM: Final = (
    Use(("gps.common_share", "team.*"), "[[servicers]]", lambda at: at.is_of_team),
    Use(
        (
            "navigation.difference_noise_m",
            "navigation.difference_error_sigma_m",
            "navigation.difference_error_time_constant_s",
            "gps_differences.*",
            "link_range.*",
        ),
        "[[servicers]] and navigation.sharing",
        lambda at: at.sharing != "none",
    ),
    Use(
        ("gps_differences.noise_m", "gps_differences.slow_error_m", "gps_differences.slow_error_time_constant_s"),
        "gps_differences.kind = 'carrier'",
        lambda at: at.file.gps_differences.kind == "carrier",
    ),
    Use(
        (
            "link_range.noise_m",
            "link_range.bias_sigma_m",
            "navigation.difference_range_noise_m",
            "navigation.difference_range_bias_sigma_m",
        ),
        "link_range.enabled = true",
        lambda at: at.file.link_range.enabled,
    ),
    Use(
        ("link.*",),
        "navigation.sharing = 'boxes', 'estimates' or 'naive'",
        lambda at: at.sharing not in ("none", "central"),
    ),
    Use(
        ("link.burst_loss", "link.burst_duration_s"),
        f"a link.burst_interval_s below {_WITHOUT_BURSTS_S:g}",
        lambda at: at.reach.low("link.burst_interval_s") < _WITHOUT_BURSTS_S,
    ),
    Use(
        ("team.lost_after_s", "team.phase_rate_deg_h"),
        "team.phasing = 'spread' or 'viewpoints'",
        lambda at: at.file.team.phasing != "fixed",
    ),
    Use(
        ("team.view_incidence_deg", "team.view_sun_incidence_deg", "team.view_memory_s", "team.keeping_delta_v_m_s"),
        "team.phasing = 'viewpoints'",
        lambda at: at.file.team.phasing == "viewpoints",
    ),
)

USES: Final = (*_PLANT, *_CAMERA, *_DELAYS, *_FLIGHT, *_TEAM)
"""Conditions of keys of sections."""


def _has_amplitude(name: str) -> Callable[[Situation, PhaseSection], bool]:
    """Whether an amplitude of a phase's relative orbit is not zero; a team that chooses phases takes them anyhow."""

    def holds(at: Situation, phase: PhaseSection) -> bool:
        if not isinstance(phase.reference, RelativeOrbitSection) or at.file.team.phasing != "fixed":
            return True
        return at.can_differ_from_zero(f"phases.{phase.name}.reference.{name}")

    return holds


PHASE_USES: Final = (
    PhaseUse(("on_timeout",), "timeout_s", lambda _, phase: phase.timeout_s is not None),
    PhaseUse(
        ("control_period_s", "position_weight", "velocity_weight", "delta_v_weight"),
        "pointing = 'target'",
        lambda _, phase: phase.pointing == "target",
    ),
    PhaseUse(
        ("reference.speed_ratio",),
        "reference.pulses above 2",
        lambda _, phase: not isinstance(phase.reference, TransferSection) or phase.reference.pulses > 2,
    ),
    PhaseUse(("reference.radial_phase_deg",), "a reference.radial_m above 0", _has_amplitude("radial_m")),
    PhaseUse(
        ("reference.cross_track_phase_deg",), "a reference.cross_track_m above 0", _has_amplitude("cross_track_m")
    ),
)
"""Conditions of keys of a phase; a phase has only some of them."""


def _has_kind(*kinds: str) -> Callable[[Situation, str], bool]:
    return lambda at, fault: bool(at.kinds_of(fault) & {*kinds})


FAULT_USES: Final = (
    FaultUse(
        ("kind", "start_s", "duration_s", "severity", "wheel", "thruster"),
        "effects.faults = true",
        lambda at, _: at.file.effects.faults,
    ),
    FaultUse(
        ("start_s", "duration_s", "severity", "wheel", "thruster"),
        "a kind other than 'none'",
        lambda at, fault: bool(at.kinds_of(fault)),
    ),
    FaultUse(
        ("kind", "start_s", "duration_s"),
        "navigation.sharing",
        lambda at, fault: at.kinds_of(fault) != {"radio_off"} or at.sharing != "none",
    ),
    FaultUse(
        ("severity",),
        "kind = 'thruster_weak', 'thruster_leak' or 'wheel_friction'",
        _has_kind("thruster_weak", "thruster_leak", "wheel_friction"),
    ),
    FaultUse(("wheel",), "kind = 'wheel_stuck' or 'wheel_friction'", _has_kind("wheel_stuck", "wheel_friction")),
    FaultUse(
        ("thruster",),
        "[[thrusters]], and the kind of a fault of one",
        lambda at, fault: bool(at.file.thrusters) and any(kind.startswith("thruster_") for kind in at.kinds_of(fault)),
    ),
    FaultUse(("start_s",), "a longer duration_s", lambda at, fault: not at.ends_before(f"faults.{fault}.start_s")),
)
"""Conditions of keys of a fault."""


_HANDED: Final[dict[str, tuple[str, ...]]] = {
    "orbit_update": ("navigation.",),
    "orbit_predict": ("navigation.",),
    "reference": ("phases.",),
    "mission_manager": ("mission.", "phases."),
    "team_phasing": ("team.", "phases."),
}
"""Beginnings of the keys whose numbers a stage is handed: a replaced one may read them where the packaged does not."""


def unused_keys(at: Situation) -> dict[str, str]:
    """Keys of a scenario that have no effect, with what would give them one; none that a replaced stage may read."""
    handed = tuple(start for stage in at.replaced for start in _HANDED.get(stage, ()))
    return {key: needs for key, needs in _unused_by_packaged(at).items() if not key.startswith(handed)}


def _unused_by_packaged(at: Situation) -> dict[str, str]:
    """Keys that have no effect with the packaged flight software."""
    found: dict[str, str] = {}
    for use in USES:
        if not use.holds(at):
            for pattern in use.keys:
                for key in keys_of(pattern):
                    found.setdefault(key, use.needs)
    for phase in at.file.phases:
        for use in PHASE_USES:
            if not use.holds(at, phase):
                found |= {f"phases.{phase.name}.{name}": use.needs for name in use.keys}
    for fault in at.file.faults:
        for use in FAULT_USES:
            if not use.holds(at, fault.name):
                for name in use.keys:
                    found.setdefault(f"faults.{fault.name}.{name}", use.needs)
    return found


def keys_of(pattern: str) -> list[str]:
    """Keys for which an entry of the table stands."""
    section, _, name = pattern.partition(".")
    if name != "*":
        return [pattern]
    declared = ScenarioFile.model_fields[section].annotation
    assert isinstance(declared, type)
    assert issubclass(declared, Section)
    return [f"{section}.{each}" for each in declared.model_fields]
