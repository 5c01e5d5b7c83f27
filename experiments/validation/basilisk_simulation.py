"""Basilisk (`bsk`) simulation of the inputs of a reference.

Order inside a step: commands and environment are updated before the spacecraft, so that what is written between two
steps acts over the next one. Basilisk holds air density and shadow factor over a step.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from Basilisk.architecture import messaging  # pyright: ignore[reportMissingImports]
from Basilisk.fswAlgorithms import (  # pyright: ignore[reportMissingImports]
    attTrackingError,
    mrpFeedback,
    rwMotorTorque,
)
from Basilisk.simulation import (  # pyright: ignore[reportMissingImports]
    GravityGradientEffector,
    dragDynamicEffector,
    eclipse,
    exponentialAtmosphere,
    extForceTorque,
    radiationPressure,
    reactionWheelStateEffector,
    simpleNav,
    spacecraft,
    sphericalHarmonicsGravityModel,
    svIntegrators,
)
from Basilisk.utilities import SimulationBaseClass, simIncludeGravBody  # pyright: ignore[reportMissingImports]

from experiments.validation.reference_file import quaternion_from_mrp

Numbers = np.ndarray
Arrays = dict[str, Numbers]
Integrator = Literal["rk4", "rkf78"]

TOLERANCE = 1e-14
"""Relative and absolute tolerance of the adaptive integrator."""

_SECOND = 1_000_000_000
"""Nanoseconds per second, the time unit of Basilisk."""

_BEFORE, _CRAFT, _AFTER = 100, 50, 10
"""Priorities within a step: higher numbers run first."""


@dataclass(frozen=True)
class SimulationCase:
    """Inputs and duration of a simulation.

    Attributes:
        inputs: parameters, initial state and commands under the keys of a reference file
        gravity_gradient: whether the gravity-gradient torque acts
        duration_s: [s]
        step_s: outer step [s]; commands and burn edges are at multiples of it
        sample_s: spacing of the samples, a multiple of the step [s]
        integrator: within a step
    """

    inputs: Arrays
    gravity_gradient: bool
    duration_s: float
    step_s: float
    sample_s: float
    integrator: Integrator = "rkf78"


class BasiliskSimulation:
    """Basilisk simulation; `simulate` returns the histories of a reference file."""

    def __init__(self, run: SimulationCase) -> None:
        self.run = run
        self.inputs = run.inputs
        self.sim = SimulationBaseClass.SimBaseClass()
        process = self.sim.CreateNewProcess("process")
        process.addTask(self.sim.CreateNewTask("task", round(run.step_s * _SECOND)))
        self.keep_alive: list[Any] = []  # Basilisk does not keep objects alive that only C++ refers to.
        self.planet = self._planet()
        self.craft = {name: self._craft(name) for name in self._names()}
        self.samplers: dict[str, Callable[[], Any]] = {}
        equipped = list(self.craft.values())[-1]  # with two spacecraft, the chaser
        if run.gravity_gradient:
            self._add_gravity_gradient(equipped)
        self.wheel_message = self._add_wheels(equipped) if "gs" in self.inputs else None
        self.force = self._add_force(equipped) if "burns" in self.inputs else None
        if "Cd" in self.inputs:
            self._add_drag(equipped)
        if "Cr" in self.inputs:
            self._add_sunlight(equipped)
        if "K" in self.inputs:
            self._add_feedback(equipped)

    def simulate(self) -> Arrays:
        """Simulates from the start and samples the state."""
        self.sim.InitializeSimulation()
        steps = round(self.run.duration_s / self.run.step_s)
        every = round(self.run.sample_s / self.run.step_s)
        driven = self.force is not None or (self.wheel_message is not None and "u_cmd" in self.inputs)
        stride = 1 if driven else every
        rows: list[Arrays] = []
        self._advance(0)
        rows.append(self._sample(0))
        for step in range(0, steps, stride):
            self._command(step)
            self._advance(step + stride)
            if (step + stride) % every == 0:
                rows.append(self._sample(step + stride))
        return _histories(rows)

    def _advance(self, step: int) -> None:
        self.sim.ConfigureStopTime(step * round(self.run.step_s * _SECOND))
        self.sim.ExecuteSimulation()

    def _command(self, step: int) -> None:
        """Writes the commands that act from this step to the next."""
        now = step * self.run.step_s
        if self.wheel_message is not None and "u_cmd" in self.inputs:
            row = int(np.searchsorted(self.inputs["t_cmd"], now + 1e-9, side="right")) - 1
            self.wheel_message.write(
                _torque_message(self.inputs["u_cmd"][row]), step * round(self.run.step_s * _SECOND)
            )
        if self.force is not None:
            force, torque = self._thrust(now)
            self.force.extForce_B = [[component] for component in force]
            self.force.extTorquePntB_B = [[component] for component in torque]

    def _thrust(self, now: float) -> tuple[Numbers, Numbers]:
        force, torque = np.zeros(3), np.zeros(3)
        for index, start, on_time in self.inputs["burns"]:
            if start - 1e-9 <= now < start + on_time - 1e-9:
                place = int(index)
                own = float(self.inputs["F_max"]) * self.inputs["thr_dir"][place]
                force, torque = force + own, torque + np.cross(self.inputs["thr_loc"][place], own)
        return force, torque

    def _sample(self, step: int) -> Arrays:
        row: Arrays = {"t": np.array(step * self.run.step_s)}
        for name, craft in self.craft.items():
            state = craft.scStateOutMsg.read()
            row |= {f"r{name}": np.array(state.r_BN_N), f"v{name}": np.array(state.v_BN_N)}
            row |= {"sigma_BN": np.array(state.sigma_BN), "omega": np.array(state.omega_BN_B)}
        row |= {key: np.array(sampler()) for key, sampler in self.samplers.items()}
        return {key: value for key, value in row.items() if self._is_of_interest(key)}

    def _is_of_interest(self, key: str) -> bool:
        if key in ("sigma_BN", "omega"):
            return "I" in self.inputs
        return key[0] not in "rv" or "mu" in self.inputs

    def _names(self) -> tuple[str, ...]:
        return ("_target", "_chaser") if "r0_target" in self.inputs else ("",)

    def _add(self, model: Any, name: str, priority: int) -> None:
        model.ModelTag = name
        self.sim.AddModelToTask("task", model, priority)
        self.keep_alive.append(model)

    def _planet(self) -> Any:
        if "mu" not in self.inputs:
            return None
        factory = simIncludeGravBody.gravBodyFactory()
        radius = float(self.inputs["Re"])
        planet = factory.createCustomGravObject("earth", float(self.inputs["mu"]), radEquator=radius)
        planet.isCentralBody = True
        zonals = self.inputs["J"]
        if zonals.size:
            planet.gravityModel = _spherical_harmonics(float(self.inputs["mu"]), radius, zonals)
        self.keep_alive.append(factory)
        return planet

    def _craft(self, name: str) -> Any:
        craft, inputs = spacecraft.Spacecraft(), self.inputs
        craft.hub.mHub = float(inputs.get("m", np.array(1.0)))
        craft.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
        craft.hub.IHubPntBc_B = inputs.get("I", np.eye(3)).tolist()
        if "mu" in inputs:
            craft.hub.r_CN_NInit = inputs[f"r0{name}"].tolist()
            craft.hub.v_CN_NInit = inputs[f"v0{name}"].tolist()
            self.keep_alive[0].addBodiesTo(craft)
        if "sigma0" in inputs:
            craft.hub.sigma_BNInit = [[component] for component in inputs["sigma0"]]
            craft.hub.omega_BN_BInit = [[component] for component in inputs["omega0"]]
        self._integrate(craft)
        self._add(craft, f"craft{name}", _CRAFT)
        return craft

    def _integrate(self, craft: Any) -> None:
        if self.run.integrator == "rk4":
            integrator = svIntegrators.svIntegratorRK4(craft)
        else:
            integrator = svIntegrators.svIntegratorRKF78(craft)
            integrator.relTol = integrator.absTol = TOLERANCE
        craft.setIntegrator(integrator)
        self.keep_alive.append(integrator)

    def _add_gravity_gradient(self, craft: Any) -> None:
        effector = GravityGradientEffector.GravityGradientEffector()
        effector.addPlanetName(self.planet.planetName)
        craft.addDynamicEffector(effector)
        self._add(effector, "gravity gradient", _BEFORE)

    def _add_wheels(self, craft: Any) -> Any:
        effector = reactionWheelStateEffector.ReactionWheelStateEffector()
        for place in range(self.inputs["gs"].shape[0]):
            effector.addReactionWheel(self._wheel(place))
        message = messaging.ArrayMotorTorqueMsg().write(_torque_message(np.zeros(self.inputs["gs"].shape[0])))
        effector.rwMotorCmdInMsg.subscribeTo(message)
        craft.addStateEffector(effector)
        self._add(effector, "wheels", _BEFORE - 10)
        # The effector's own message is written before the step, so it is one step old.
        self.samplers["Omega"] = lambda: _state_vector(craft, effector.nameOfReactionWheelOmegasState)
        self.keep_alive.append(message)
        return message

    def _wheel(self, place: int) -> Any:
        wheel = reactionWheelStateEffector.RWConfigPayload()
        wheel.RWModel = messaging.BalancedWheels
        wheel.gsHat_B = [[component] for component in self.inputs["gs"][place]]
        wheel.rWB_B = [[0.0], [0.0], [0.0]]
        wheel.Js, wheel.Omega = _item_or_scalar(self.inputs["Js"], place), float(self.inputs["Omega0"][place])
        wheel.u_max = _item_or_scalar(self.inputs.get("u_max", np.array(-1.0)), place)
        wheel.Omega_max = wheel.P_max = wheel.betaStatic = -1.0
        self.keep_alive.append(wheel)
        return wheel

    def _add_force(self, craft: Any) -> Any:
        effector = extForceTorque.ExtForceTorque()
        craft.addDynamicEffector(effector)
        self._add(effector, "thrust", _BEFORE)
        return effector

    def _add_drag(self, craft: Any) -> None:
        air = exponentialAtmosphere.ExponentialAtmosphere()
        air.planetRadius = float(self.inputs["Re"])
        air.scaleHeight, air.baseDensity = float(self.inputs["H"]), float(self.inputs["rho0"])
        air.addSpacecraftToModel(craft.scStateOutMsg)
        drag = dragDynamicEffector.DragDynamicEffector()
        drag.coreParams.projectedArea = float(self.inputs["A"])
        drag.coreParams.dragCoeff = float(self.inputs["Cd"])
        drag.coreParams.comOffset = [0.0, 0.0, 0.0]
        drag.atmoDensInMsg.subscribeTo(air.envOutMsgs[0])
        craft.addDynamicEffector(drag)
        self._add(air, "air", _BEFORE)
        self._add(drag, "drag", _BEFORE - 10)

    def _add_sunlight(self, craft: Any) -> None:
        sun = _planet_state_message(messaging, self.inputs["r_sun"])
        self.keep_alive.append(sun)
        held, sampled = (self._shadow(craft, sun, priority) for priority in (_BEFORE, _AFTER))
        pressure = radiationPressure.RadiationPressure()
        pressure.area = float(self.inputs["A"])
        pressure.coefficientReflection = float(self.inputs["Cr"])
        pressure.sunEphmInMsg.subscribeTo(sun)
        pressure.sunEclipseInMsg.subscribeTo(held.eclipseOutMsgs[0])
        craft.addDynamicEffector(pressure)
        self._add(pressure, "sunlight", _BEFORE - 10)
        self.samplers["illumination"] = lambda: sampled.eclipseOutMsgs[0].read().shadowFactor

    def _shadow(self, craft: Any, sun: Any, priority: int) -> Any:
        """Shadow model: one before the spacecraft moves, which acts, and one after it for the sampled state."""
        shadow = eclipse.Eclipse()
        shadow.sunInMsg.subscribeTo(sun)
        planet = _planet_state_message(messaging, np.zeros(3), "earth")
        shadow.addPlanetToModel(planet)
        shadow.addSpacecraftToModel(craft.scStateOutMsg)
        self._add(shadow, f"shadow {priority}", priority)
        self.keep_alive.append(planet)
        return shadow

    def _add_feedback(self, craft: Any) -> None:
        """Basilisk's attitude feedback to the inertial frame, once per step."""
        sensed = simpleNav.SimpleNav()
        sensed.scStateInMsg.subscribeTo(craft.scStateOutMsg)
        wanted = messaging.AttRefMsg().write(messaging.AttRefMsgPayload())
        error = attTrackingError.attTrackingError()
        error.attNavInMsg.subscribeTo(sensed.attOutMsg)
        error.attRefInMsg.subscribeTo(wanted)
        control = mrpFeedback.mrpFeedback()
        control.K, control.P, control.Ki = float(self.inputs["K"]), float(self.inputs["P"]), -1.0
        control.integralLimit = 0.1
        body = messaging.VehicleConfigMsgPayload()
        body.ISCPntB_B = self.inputs["I"].ravel().tolist()
        body_message = messaging.VehicleConfigMsg().write(body)
        control.guidInMsg.subscribeTo(error.attGuidOutMsg)
        control.vehConfigInMsg.subscribeTo(body_message)
        wheels = messaging.RWArrayConfigMsgPayload()
        wheels.GsMatrix_B = self.inputs["gs"].ravel().tolist()
        wheels.JsList = [float(self.inputs["Js"])] * self.inputs["gs"].shape[0]
        wheels.numRW = self.inputs["gs"].shape[0]
        wheels.uMax = [float(self.inputs["u_max"])] * wheels.numRW
        wheels_message = messaging.RWArrayConfigMsg().write(wheels)
        share = rwMotorTorque.rwMotorTorque()
        share.controlAxes_B = np.eye(3).ravel().tolist()
        share.rwParamsInMsg.subscribeTo(wheels_message)
        share.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
        self._wheel_effector().rwMotorCmdInMsg.subscribeTo(share.rwMotorTorqueOutMsg)
        for place, (name, model) in enumerate(
            {"nav": sensed, "error": error, "control": control, "share": share}.items()
        ):
            self._add(model, name, _BEFORE - place)
        self.keep_alive += [wanted, body_message, wheels_message]
        count = wheels.numRW
        self.samplers["u_last"] = lambda: share.rwMotorTorqueOutMsg.read().motorTorque[:count]

    def _wheel_effector(self) -> Any:
        return next(model for model in self.keep_alive if getattr(model, "ModelTag", "") == "wheels")


def _state_vector(craft: Any, name: str) -> Numbers:
    return np.array(craft.dynManager.getStateObject(name).getState()).ravel()


def _item_or_scalar(value: Numbers, place: int) -> float:
    """Item of an array, or the number that holds for all items."""
    return float(value.ravel()[place] if value.size > 1 else value.item())


def _spherical_harmonics(mu: float, radius: float, zonals: Numbers) -> Any:
    """Gravity model with fully normalised coefficients, as Basilisk expects."""
    degree = zonals.size + 1
    cosine = [[0.0] * (row + 1) for row in range(degree + 1)]
    cosine[0][0] = 1.0
    for n, value in enumerate(zonals, start=2):
        cosine[n][0] = -float(value) / np.sqrt(2 * n + 1)
    model = sphericalHarmonicsGravityModel.SphericalHarmonicsGravityModel()
    model.muBody, model.radEquator, model.maxDeg = mu, radius, degree
    model.cBar, model.sBar = cosine, [[0.0] * (row + 1) for row in range(degree + 1)]
    return model


def _torque_message(values: Numbers) -> Any:
    payload = messaging.ArrayMotorTorqueMsgPayload()
    payload.motorTorque = values.tolist()
    return payload


def _planet_state_message(messages: Any, position: Numbers, name: str = "sun") -> Any:
    payload = messages.SpicePlanetStateMsgPayload()
    payload.PositionVector = position.tolist()
    payload.J20002Pfix = np.eye(3).tolist()
    payload.PlanetName = name
    return messages.SpicePlanetStateMsg().write(payload)


def _histories(rows: list[Arrays]) -> Arrays:
    """Samples stacked over time, with the attitude as a quaternion of continuous sign."""
    stacked = {key: np.stack([row[key] for row in rows]) for key in rows[-1]}
    if "sigma_BN" in stacked:
        q = quaternion_from_mrp(stacked["sigma_BN"])
        turned = np.concatenate([[1.0], np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)])
        stacked["q"] = q * np.cumprod(turned)[:, None]
        del stacked["sigma_BN"]
    return stacked
