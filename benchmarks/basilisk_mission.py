"""A mission like `inspection` in Basilisk with compiled modules only; `against_basilisk` starts it once per core.

Two craft, J2, gravity gradient on both, three wheels, one thruster. Simple navigation at 5 Hz and 1 Hz, pointing at the
target, feedback at 5 Hz, and a relative orbit control that turns the craft for its burns and back.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from Basilisk.architecture import messaging  # pyright: ignore[reportMissingImports]
from Basilisk.fswAlgorithms import (  # pyright: ignore[reportMissingImports]
    attTrackingError,
    locationPointing,
    mrpFeedback,
    rwMotorTorque,
    spacecraftReconfig,
)
from Basilisk.simulation import simpleNav, thrusterDynamicEffector  # pyright: ignore[reportMissingImports]
from Basilisk.utilities import fswSetupThrusters  # pyright: ignore[reportMissingImports]

from experiments.validation.basilisk_simulation import Arrays, BasiliskSimulation, Numbers, SimulationCase
from experiments.validation.make_references import add_hill_position

STEP_S, TICK_S = 0.2, 1.0
"""Of dynamics and attitude control; of guidance, orbit control and record, all as in `inspection`."""

TURN_S = 120.0
"""Time before a burn at which the craft begins to turn [s]; a turn of 180 degrees takes most of it."""

STIFFNESS, DAMPING = 0.08, 0.5
"""Of the attitude feedback [N m], [N m s]: soft enough for turns of 180 degrees with the wheels' torque limit."""

POSITION_M, VELOCITY_M_S, ANGLE_RAD, RATE_RAD_S = 0.05, 5e-4, 5e-5, 2e-5
"""Bounds of the random-walk navigation errors, no larger than those of filtered estimates, as there is no filter."""

_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class SimulatedMission:
    """Timing and errors of one run.

    Attributes:
        setup_s: building and initialising [s]
        flight_s: simulation, until its record is in numpy [s]
        cpu_s: processor time of both [s]
        formation_error_m: (ticks,) distance from the desired position in the target's Hill frame
        pointing_error_deg: (ticks,) angle from the reference attitude
        burn_s: time with thrust [s]
    """

    setup_s: float
    flight_s: float
    cpu_s: float
    formation_error_m: Numbers
    pointing_error_deg: Numbers
    burn_s: float


class Mission(BasiliskSimulation):
    """One run; `inputs` are those of a reference file and the keys of the target and the thruster."""

    def __init__(self, inputs: Arrays, duration_s: float, seed: int) -> None:
        super().__init__(SimulationCase(inputs, True, duration_s, STEP_S, TICK_S, "rk4"))
        self.seed = seed
        self.target, self.chaser = self.craft.values()
        self._set_target()
        process = self.sim.procList[0]
        process.addTask(self.sim.CreateNewTask("guidance", round(TICK_S * _NANOSECONDS)), -2)
        process.addTask(self.sim.CreateNewTask("control", round(STEP_S * _NANOSECONDS)), -3)
        process.addTask(self.sim.CreateNewTask("record", round(TICK_S * _NANOSECONDS)), -4)
        self._add_guidance()
        self._add_control()
        self._add_thruster()
        self._add_record()

    def record(self) -> Arrays:
        """Simulates the mission without interruption and returns what was recorded once per tick."""
        self.sim.ConfigureStopTime(round(self.run.duration_s * _NANOSECONDS))
        self.sim.ExecuteSimulation()
        target, chaser = self.recorders["target"], self.recorders["chaser"]
        return {
            "r_target": np.array(target.r_BN_N),
            "v_target": np.array(target.v_BN_N),
            "r_chaser": np.array(chaser.r_BN_N),
            "sigma_error": np.array(self.recorders["error"].sigma_BR),
            "thrust": np.array(self.recorders["thruster"].thrustFactor),
        }

    # Building.

    def _schedule(self, task: str, model: Any, name: str) -> None:
        model.ModelTag = name
        self.sim.AddModelToTask(task, model)
        self.keep_alive.append(model)

    def _set_target(self) -> None:
        hub, inputs = self.target.hub, self.inputs
        hub.mHub, hub.IHubPntBc_B = float(inputs["m_target"]), inputs["I_target"].tolist()
        hub.sigma_BNInit = inputs["sigma0_target"][:, None].tolist()
        hub.omega_BN_BInit = inputs["omega0_target"][:, None].tolist()
        self._add_gravity_gradient(self.target)

    def _navigation(self, craft: Any, task: str, name: str) -> Any:
        navigation = simpleNav.SimpleNav()
        navigation.scStateInMsg.subscribeTo(craft.scStateOutMsg)
        bounds = np.repeat([POSITION_M, VELOCITY_M_S, 0.25 * ANGLE_RAD, RATE_RAD_S, 0.0, 0.0], 3)
        navigation.walkBounds = bounds[:, None].tolist()
        navigation.PMatrix = np.diag(0.1 * bounds).tolist()
        navigation.RNGSeed = 1 + (self.seed * 8 + len(self.keep_alive)) % 0x7FFFFFFF
        self._schedule(task, navigation, name)
        return navigation

    def _add_guidance(self) -> None:
        """Adds target pointing, whose attitude the orbit control replaces around a burn."""
        own, other = (self._navigation(craft, "guidance", f"position of {craft.ModelTag}") for craft in self.pair())
        target_pointing = locationPointing.locationPointing()
        target_pointing.pHat_B = [1.0, 0.0, 0.0]
        target_pointing.scTransInMsg.subscribeTo(own.transOutMsg)
        target_pointing.scAttInMsg.subscribeTo(own.attOutMsg)
        target_pointing.scTargetInMsg.subscribeTo(other.transOutMsg)
        orbit = spacecraftReconfig.spacecraftReconfig()
        orbit.mu, orbit.attControlTime = float(self.inputs["mu"]), TURN_S
        orbit.targetClassicOED = self.inputs["desired_elements"].tolist()
        orbit.chiefTransInMsg.subscribeTo(other.transOutMsg)
        orbit.deputyTransInMsg.subscribeTo(own.transOutMsg)
        orbit.attRefInMsg.subscribeTo(target_pointing.attRefOutMsg)
        orbit.thrustConfigInMsg.subscribeTo(self._keep(self._nominal_thruster_message()))
        self.body_message = self._keep(self._nominal_body_message())
        orbit.vehicleConfigInMsg.subscribeTo(self.body_message)
        self._schedule("guidance", target_pointing, "target pointing")
        self._schedule("guidance", orbit, "orbit control")
        self.orbit_control = orbit

    def pair(self) -> tuple[Any, Any]:
        """Chaser and target."""
        return self.chaser, self.target

    def _keep(self, message: Any) -> Any:
        self.keep_alive.append(message)
        return message

    def _nominal_thruster_message(self) -> Any:
        fswSetupThrusters.clearSetup()
        fswSetupThrusters.create([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], float(self.inputs["F_nominal"]))
        return fswSetupThrusters.writeConfigMessage()

    def _nominal_body_message(self) -> Any:
        payload = messaging.VehicleConfigMsgPayload()
        payload.ISCPntB_B, payload.massSC = self.inputs["I"].ravel().tolist(), float(self.inputs["m_nominal"])
        return messaging.VehicleConfigMsg().write(payload)

    def _add_control(self) -> None:
        navigation = self._navigation(self.chaser, "control", "attitude")
        error = attTrackingError.attTrackingError()
        error.attNavInMsg.subscribeTo(navigation.attOutMsg)
        error.attRefInMsg.subscribeTo(self.orbit_control.attRefOutMsg)
        control = mrpFeedback.mrpFeedback()
        control.K, control.P, control.Ki, control.integralLimit = STIFFNESS, DAMPING, -1.0, 0.1
        control.guidInMsg.subscribeTo(error.attGuidOutMsg)
        control.vehConfigInMsg.subscribeTo(self.body_message)
        wheel_torque = rwMotorTorque.rwMotorTorque()
        wheel_torque.controlAxes_B = np.eye(3).ravel().tolist()
        wheel_torque.rwParamsInMsg.subscribeTo(self._keep(self._wheel_message()))
        wheel_torque.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
        self._wheel_effector().rwMotorCmdInMsg.subscribeTo(wheel_torque.rwMotorTorqueOutMsg)
        for name, model in {"error": error, "control": control, "wheel torque": wheel_torque}.items():
            self._schedule("control", model, name)
        self.error = error

    def _wheel_message(self) -> Any:
        payload, count = messaging.RWArrayConfigMsgPayload(), self.inputs["gs"].shape[0]
        payload.GsMatrix_B = self.inputs["gs"].ravel().tolist()
        payload.JsList, payload.uMax = self.inputs["Js"].tolist(), self.inputs["u_max"].tolist()
        payload.numRW = count
        return messaging.RWArrayConfigMsg().write(payload)

    def _add_thruster(self) -> None:
        config = thrusterDynamicEffector.THRSimConfig()
        config.thrLoc_B, config.thrDir_B = (self.inputs[key][0][:, None].tolist() for key in ("thr_loc", "thr_dir"))
        config.MaxThrust, config.steadyIsp = float(self.inputs["F_max"]), float(self.inputs["Isp"])
        config.MinOnTime = float(self.inputs["minimum_on_s"])
        effector = thrusterDynamicEffector.ThrusterDynamicEffector()
        effector.addThruster(config)
        effector.cmdsInMsg.subscribeTo(self.orbit_control.onTimeOutMsg)
        self.chaser.addDynamicEffector(effector)
        self._add(effector, "thruster", 80)
        self.thruster = effector
        self.keep_alive.append(config)

    def _add_record(self) -> None:
        messages = {
            "target": self.target.scStateOutMsg,
            "chaser": self.chaser.scStateOutMsg,
            "error": self.error.attGuidOutMsg,
            "thruster": self.thruster.thrusterOutMsgs[0],
        }
        self.recorders = {name: message.recorder(round(TICK_S * _NANOSECONDS)) for name, message in messages.items()}
        for recorder in self.recorders.values():
            self.sim.AddModelToTask("record", recorder)


def simulate_mission(inputs: Arrays, duration_s: float, seed: int) -> SimulatedMission:
    """Builds and simulates one run, copies its record to numpy and evaluates it."""
    cpu, begin = time.process_time(), time.perf_counter()
    mission = Mission(inputs, duration_s, seed)
    mission.sim.InitializeSimulation()
    ready = time.perf_counter()
    record = mission.record()
    end, cpu_s = time.perf_counter(), time.process_time() - cpu
    return SimulatedMission(
        setup_s=ready - begin,
        flight_s=end - ready,
        cpu_s=cpu_s,
        formation_error_m=np.linalg.norm(add_hill_position(record)["rho"] - inputs["desired_position"], axis=1),
        pointing_error_deg=np.rad2deg(4.0 * np.arctan(np.linalg.norm(record["sigma_error"], axis=1))),
        burn_s=float(np.sum(record["thrust"])) * TICK_S,
    )
