"""Replaceable stages of the flight software: the signature of each as a protocol, and the record that holds them.

A stage is called with the named arguments of its protocol; a function declares those that it needs, by name, such as
`def law(deviation, time)`. Examples: `docs/how_to/flight_software.md`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import named_arguments
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.errors import RpojaxError
from rpojax.flight.control import attitude_control, formation_law
from rpojax.flight.control.attitude_control import AttitudeCommand, AttitudeControlTuning
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import detector_window
from rpojax.flight.guidance.attitude_guidance import PointingState
from rpojax.flight.guidance.detector_window import CameraCommand, CameraFormat
from rpojax.flight.guidance.references import reference_motion
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.mission import mission_manager
from rpojax.flight.mission.mission_manager import Situation
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.mission.phase_table import MissionTuning
from rpojax.flight.mission.static_mission_settings import MissionSettings
from rpojax.flight.navigation import attitude_ekf, combined_orbit_filter
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate, AttitudeFilterTuning
from rpojax.flight.navigation.believed_sensor import SensorRows
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import Innovation, OrbitEstimate
from rpojax.flight.navigation.lasting_error_effects import LastingEffects
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.flight.navigation.retrodiction import Exposure
from rpojax.flight.team_guidance import phase_assignment
from rpojax.flight.team_guidance.team_situation import TeamSituation, TeamTuning
from rpojax.flight.vehicle_model import VehicleModel

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


class InitialMemory(Protocol):
    """Memory of one's own, which the stages that declare an argument `own` get and the filter's stages change."""

    def __call__(
        self, *, params: FlightParams, estimate: OrbitEstimate, attitude: AttitudeEstimate, camera: CameraFormat
    ) -> Any:
        """Arrays or records of them (a pytree) at the start of a run.

        Args:
            params: tuning of the flight software, and its vehicle model
            estimate: of both orbits at the hand-over
            attitude: estimate of the attitude then
            camera: sizes of the camera's images
        """
        ...


class AttitudeUpdate(Protocol):
    """Measurement update of the attitude filter."""

    def __call__(
        self,
        *,
        tuning: AttitudeFilterTuning,
        estimate: AttitudeEstimate,
        star_tracker_q_BN: Float[Array, "4"],
        present: Bool[Array, ""],
        orbit: OrbitEstimate,
        time: Scalar,
    ) -> AttitudeEstimate:
        """Estimate after the star tracker.

        Args:
            tuning: of the filter
            estimate: of the attitude before the measurement, propagated by the gyro
            star_tracker_q_BN: (4,) measured attitude
            present: () bool, whether there is a measurement
            orbit: estimate of both orbits
            time: () since the start of the run [s]
        """
        ...


class OrbitUpdate(Protocol):
    """Measurement update of the orbit filter."""

    def __call__(
        self,
        *,
        tuning: OrbitFilterTuning,
        gated: bool,
        focal_px: Scalar,
        estimate: OrbitEstimate,
        gate: GateState,
        gps: GpsMeasurement,
        q_KN: Float[Array, "4"],
        box: BoxMeasurement,
        additional: Mapping[str, Array],
        sensors: Mapping[str, SensorRows],
        picture: Float[Array, "p p 3"] | None,
        window: CameraCommand,
        exposures: Mapping[str, Exposure],
        time: Scalar,
    ) -> tuple[OrbitEstimate, GateState, Innovation]:
        """Estimate after GPS and box, state of the outlier gate, and diagnostics.

        Args:
            tuning: of the filter
            gated: whether boxes must pass the gate
            focal_px: () of the camera [px]
            estimate: before the measurements
            gate: state of the outlier gate
            gps: position, if present
            q_KN: (4,) attitude of the camera at the exposure of the box, by the attitude filter
            box: bounding box, if present
            additional: measurements of additional sensors by name
            sensors: rows of those that the filter is to believe, by name, as functions of the relative estimate
            picture: (p, p, 3) that the detector got, sRGB codes in 0..1; with a `rendered` camera, and asked for alone
            window: place of the picture in the frame
            exposures: of the sensors whose measurements are late, by name, `camera` among them
            time: () since the start of the run [s]
        """
        ...


class OrbitPrediction(Protocol):
    """Propagation of the orbit filter over one tick."""

    def __call__(
        self,
        *,
        tuning: OrbitFilterTuning,
        zonal_degree: int,
        estimate: OrbitEstimate,
        delta_v_N: Vector,
        burn_delta_v: Scalar,
        burn_sigma_inflation: Scalar,
        third_body_acceleration_N: Vector,
        lasting: LastingEffects,
        time: Scalar,
        dt: float,
    ) -> OrbitEstimate:
        """Estimate `dt` later.

        Args:
            tuning: of the filter
            zonal_degree: highest zonal harmonic of the gravity model
            estimate: at the beginning of the tick
            delta_v_N: (3,) velocity change by the thruster during the tick [m/s]
            burn_delta_v: () size of the whole burn that it is a part of [m/s]
            burn_sigma_inflation: () factor on the sigma of the burn's magnitude
            third_body_acceleration_N: (3,) of the servicer by Sun and Moon [m/s^2]
            lasting: effect of errors of thrust and of drag that last
            time: () of the estimate since the start of the run [s]
            dt: length of the tick [s]
        """
        ...


class ReferenceMotion(Protocol):
    """Reference trajectory of a phase."""

    def __call__(
        self, *, phase: str, reference: Any, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar
    ) -> Float[Array, "6"]:
        """Desired (rho, rho_dot) in the target's Hill frame [m, m/s].

        Args:
            phase: its name; `hold` and `aborted` for the built-in ones
            reference: parameters of the phase's reference
            entry: relative state in which the phase began
            orbit: of the target at the asked time
            elapsed: () since the entry, negative before it [s]
        """
        ...


class MissionManagement(Protocol):
    """Transitions between the phases of a mission."""

    def __call__(
        self, *, settings: MissionSettings, tuning: MissionTuning, state: MissionState, situation: Situation
    ) -> MissionState:
        """State of the mission after a decision.

        Args:
            settings: number, order and kinds of the phases
            tuning: their numbers
            state: before the decision
            situation: what is known on board
        """
        ...


class TeamPhasing(Protocol):
    """Choice of the phase of a servicer's relative orbit in its team."""

    def __call__(self, *, settings: MissionSettings, tuning: TeamTuning, team: TeamSituation) -> Scalar:
        """Angle () by which this servicer's relative orbit is to be ahead of the plan [rad].

        Args:
            settings: of the mission
            tuning: of the guidance of the team
            team: as this servicer knows it, from its own estimate and what the others sent
        """
        ...


class FormationLaw(Protocol):
    """Control law of the formation."""

    def __call__(
        self, *, gain: Float[Array, "3 6"], deviation: Float[Array, "6"], estimate: OrbitEstimate, time: Scalar
    ) -> Vector:
        """Velocity change (3,) of the next burn in the target's Hill frame [m/s].

        Args:
            gain: (3, 6) of the LQR
            deviation: (6,) of (rho, rho_dot) from the desired state, predicted to the middle of the burn [m, m/s]
            estimate: of both orbits at the decision
            time: () of the decision since the start of the run [s]
        """
        ...


class WheelControl(Protocol):
    """Attitude control by the reaction wheels."""

    def __call__(
        self,
        *,
        control: AttitudeControlTuning,
        vehicle: VehicleModel,
        allocation: Float[Array, "3 3"],
        estimate: AttitudeEstimate,
        command: AttitudeCommand,
        wheel_speed: Vector,
        orbit: OrbitEstimate,
        time: Scalar,
    ) -> Vector:
        """Motor torque command (3,) of the wheels [N m], constant over a plant step.

        Args:
            control: gains
            vehicle: nominal properties of the servicer
            allocation: (3, 3) body torque to wheel torques
            estimate: of the attitude, propagated by the gyro
            command: attitude motion commanded by guidance
            wheel_speed: (3,) by the tachometers [rad/s]
            orbit: estimate of both orbits
            time: () since the start of the run [s]
        """
        ...


class WindowSelection(Protocol):
    """Choice of the part of the camera's frame that the detector gets next."""

    def __call__(
        self,
        *,
        camera: CameraFormat,
        vehicle: VehicleModel,
        target_size: Scalar,
        orbit: OrbitEstimate,
        attitude: AttitudeEstimate,
        pointing: PointingState,
        time: Scalar,
    ) -> CameraCommand:
        """Window of the next exposure.

        Args:
            camera: size of the frame and of the detector's input
            vehicle: nominal properties of the servicer and its camera
            target_size: () mean size of the target's outline [m]
            orbit: estimate of both orbits at the exposure
            attitude: estimate of the attitude at the exposure
            pointing: state of the attitude guidance
            time: () of the exposure since the start of the run [s]
        """
        ...


AnyFunction = Callable[..., Any]
"""A function that declares some of the arguments of its protocol."""


def no_memory() -> tuple[()]:
    """Memory of one's own of the packaged stages: none."""
    return ()


@dataclass(frozen=True)
class Stages:
    """Replaceable stages of the flight software.

    Attributes:
        attitude_update: measurement update of the attitude filter
        orbit_update: measurement update of the orbit filter
        orbit_predict: propagation of the orbit filter
        formation_law: velocity change of a burn
        reference: trajectory that a phase follows
        mission_manager: transitions between phases
        team_phasing: phase of the relative orbit in a team
        wheel_torque: attitude control
        detector_window: window of the next exposure
        own_memory: memory of one's own, for the other stages

    Raises:
        RpojaxError: a function declares an argument that its stage does not have.
    """

    attitude_update: AttitudeUpdate | AnyFunction = field(
        default=attitude_ekf.update, metadata={"protocol": AttitudeUpdate}
    )
    orbit_update: OrbitUpdate | AnyFunction = field(
        default=combined_orbit_filter.update, metadata={"protocol": OrbitUpdate}
    )
    orbit_predict: OrbitPrediction | AnyFunction = field(
        default=combined_orbit_filter.predict, metadata={"protocol": OrbitPrediction}
    )
    formation_law: FormationLaw | AnyFunction = field(
        default=formation_law.lqr_feedback, metadata={"protocol": FormationLaw}
    )
    reference: ReferenceMotion | AnyFunction = field(
        default=reference_motion.reference_state, metadata={"protocol": ReferenceMotion}
    )
    mission_manager: MissionManagement | AnyFunction = field(
        default=mission_manager.update, metadata={"protocol": MissionManagement}
    )
    team_phasing: TeamPhasing | AnyFunction = field(default=phase_assignment.assign, metadata={"protocol": TeamPhasing})
    wheel_torque: WheelControl | AnyFunction = field(
        default=attitude_control.wheel_torque, metadata={"protocol": WheelControl}
    )
    detector_window: WindowSelection | AnyFunction = field(
        default=detector_window.select_window, metadata={"protocol": WindowSelection}
    )
    own_memory: InitialMemory | AnyFunction = field(default=no_memory, metadata={"protocol": InitialMemory})

    def __post_init__(self) -> None:
        for each in fields(self):
            function = getattr(self, each.name)
            extra = () if each.name in ("own_memory", "reference") else ("own",)
            named_arguments.check(f"stages.{each.name}", function, each.metadata["protocol"].__call__, extra)
            if getattr(function, "__hash__", None) is None:
                kind = type(function).__name__
                raise RpojaxError(f"stages.{each.name}: found a {kind} without a hash, expected a frozen one")

    @property
    def replaced(self) -> tuple[str, ...]:
        """Names of the stages that are not the packaged ones."""
        return tuple(each.name for each in fields(self) if getattr(self, each.name) is not each.default)

    @property
    def takes_picture(self) -> bool:
        """Whether the update of the orbit filter asks for the camera's picture."""
        return named_arguments.declares(self.orbit_update, "picture")

    def initial_memory(self, **arguments: Any) -> Any:
        """Memory of one's own at the start of a run, as arrays; the arguments are those of `InitialMemory`."""
        own = self._result("own_memory", arguments)
        try:
            return jax.tree.map(jnp.asarray, own)
        except TypeError:
            found = f"found a {_type_name(own)} with others"
            raise RpojaxError(f"stages.own_memory: {found}, expected numbers and arrays alone") from None

    def call(self, stage: str, own: Any = None, **arguments: Any) -> Any:
        """Result of the named stage, whose function gets those of the arguments that it declares.

        A stage that declares `own` reads the memory of one's own.

        Raises:
            RpojaxError: a replaced stage returns other arrays than the packaged one, or uses Python on traced values.
        """
        function, packaged = getattr(self, stage), getattr(Stages, stage)
        if function is packaged:
            return named_arguments.call(function, **arguments)
        result = self._result(stage, arguments, own)
        self._check(stage, result, arguments)
        return result

    def call_with_memory(self, stage: str, own: Any, **arguments: Any) -> tuple[Any, Any]:
        """Result of the named stage, and the memory of one's own, which it returns beside it if it declares `own`.

        Raises:
            RpojaxError: as of `call`, or the memory that is returned has another structure than before.
        """
        if not named_arguments.declares(getattr(self, stage), "own"):
            return self.call(stage, **arguments), own
        pair = self._result(stage, arguments, own)
        if not (isinstance(pair, tuple) and len(pair) == 2):
            expected = "the stage's result and `own`, for it declares the argument `own`"
            raise RpojaxError(f"stages.{stage}: found a result of type {_type_name(pair)}, expected {expected}")
        result, after = pair
        self._check(stage, result, arguments)
        _check_result(f"stages.{stage}, `own`", after, jax.eval_shape(lambda: own))
        return result, after

    def _check(self, stage: str, result: Any, arguments: dict[str, Any]) -> None:
        packaged = getattr(Stages, stage)
        expected = jax.eval_shape(lambda: named_arguments.call(packaged, **arguments))
        _check_result(f"stages.{stage}", result, expected)

    def _result(self, stage: str, arguments: dict[str, Any], own: Any = None) -> Any:
        """What a function returns; it gets `own` only if it declares it by name."""
        function = getattr(self, stage)
        if named_arguments.declares(function, "own"):
            arguments = arguments | {"own": own}
        try:
            return named_arguments.call(function, **arguments)
        except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError):
            raise RpojaxError(
                f"stages.{stage}: found Python's `if`, `float` or NumPy on a traced value, expected jax.numpy alone"
            ) from None


def _check_result(where: str, result: Any, expected: Any) -> None:
    """Refuses a result of another structure, shape or type than expected."""
    if jax.tree.structure(result) != jax.tree.structure(expected):
        found, wanted = _type_name(result), _type_name(expected)
        if missing := _missing(result, expected):
            found, wanted = f"{found} without {missing}", "one that has it"
        raise RpojaxError(f"{where}: found a result of type {found}, expected {wanted}")
    for (path, found), wanted in zip(jax.tree.leaves_with_path(result), jax.tree.leaves(expected), strict=True):
        kind = f"{jnp.result_type(found)} of shape {jnp.shape(found)}"
        if kind != (named := f"{wanted.dtype} of shape {wanted.shape}"):
            raise RpojaxError(f"{where}: found {kind} for the result{jax.tree_util.keystr(path)}, expected {named}")


def _missing(result: Any, expected: Any) -> str:
    """Path of the first entry that mappings in a result lack; empty if its types are others."""
    paths = [path for path, _ in jax.tree.leaves_with_path(result)]
    known = {path[:end] for path in paths for end in range(len(path) + 1)}
    entries = [path[:end] for path, _ in jax.tree.leaves_with_path(expected) for end in range(1, len(path) + 1)]
    lacking = [each for each in entries if each not in known]
    return jax.tree_util.keystr(lacking[0]) if lacking and isinstance(lacking[0][-1], jax.tree_util.DictKey) else ""


def _type_name(result: Any) -> str:
    if isinstance(result, tuple):
        return f"({', '.join(_type_name(each) for each in result)})"
    return type(result).__name__ if jax.tree.structure(result) != jax.tree.structure(0.0) else "array"
