"""Propellant, centre of mass and inertia after pulses of twelve thrusters, beside Basilisk's tank and thrusters.

    pip install bsk
    python -m experiments.close_range.basilisk_tank [--steps 400] [--seed 0]

Basilisk's hub is the dry body of the servicer, its `FuelTank` burns evenly (`FuelTankModelUniformBurn`), and its
`ThrusterDynamicEffector` draws from it. Pulses are multiples of Basilisk's step, which opens and shuts valves there.
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np
from Basilisk.architecture import messaging  # pyright: ignore[reportMissingImports]
from Basilisk.simulation import (  # pyright: ignore[reportMissingImports]
    fuelTank,
    spacecraft,
    svIntegrators,
    thrusterDynamicEffector,
)
from Basilisk.utilities import SimulationBaseClass  # pyright: ignore[reportMissingImports]

import rpojax
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults, forces_and_torques, plant, plant_state, rcs_thrusters, thruster
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import PlantParams, Truth

STEP, INNER = 0.2, 0.02
PROPELLANT, RADIUS = 4.0, 0.12
TANK = np.array([-0.1, 0.03, 0.05])
EFFECTS = Effects(center_of_mass_shift=True, inertia_change=True)
Arrays = tuple[np.ndarray, np.ndarray, np.ndarray]


def vehicle() -> tuple[PlantParams, Truth]:
    """Servicer of `final_approach`, tank beside its centre of mass, twenty times its force, far from the Earth."""
    _, params, _ = rpojax.initialise_run(rpojax.load("final_approach"), 0, 0)
    given = params.plant
    tank = replace(given.thruster, tank_position=jnp.asarray(TANK), tank_radius=jnp.asarray(RADIUS))
    strong = {name: replace(each, force=20.0 * each.force) for name, each in given.thrusters.items()}
    plant_params = replace(given, thruster=tank, thrusters=strong)
    truth = plant_state.initial_truth(
        plant_params, params.orbit, jnp.array([0.0, -50.0, 0.0]), jnp.zeros(3), jnp.array([1.0, 0.0, 0.0, 0.0])
    )
    far = replace(truth, omega_BN_B=jnp.zeros(3), plume_impulse=None, r_TN_N=jnp.array([1e14, 0.0, 0.0]))
    return plant_params, replace(far, v_TN_N=jnp.zeros(3), v_ST_N=jnp.zeros(3))


def by_rpojax(params: PlantParams, truth: Truth, on_times: np.ndarray) -> Arrays:
    """Mass (n,) [kg], centre of mass (n, 3) [m] and inertia about it (n, 3, 3) [kg m^2] after each step."""
    stacked = rcs_thrusters.stacked(params.thrusters)
    state = rcs_thrusters.true_state(stacked, jnp.zeros(len(stacked.force)), jnp.ones(len(stacked.force)))
    sky = SunMoonPositions(sun_N=jnp.array([1.5e11, 0.0, 0.0]), moon_N=jnp.array([0.0, 3.8e8, 0.0]))

    def body(truth: Truth, times: jax.Array) -> tuple[Truth, tuple[jax.Array, ...]]:
        thrust = rcs_thrusters.thrust_over_step(state, times, EFFECTS.integrator, STEP)
        after = plant.step(EFFECTS, params, truth, jnp.zeros(3), (), sky, equipment_faults.healthy(), STEP, thrust)
        shift = thruster.center_of_mass_shift(params.thruster, params.servicer.mass - after.mass, after.mass)
        return after, (after.mass, shift, forces_and_torques.servicer_inertia(EFFECTS, params, after))

    mass, shift, inertia = jax.jit(lambda start: jax.lax.scan(body, start, jnp.asarray(on_times))[1])(truth)
    return np.asarray(mass), np.asarray(shift), np.asarray(inertia)


def by_basilisk(params: PlantParams, on_times: np.ndarray) -> Arrays:
    """The same by Basilisk."""
    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("dynamics")
    process.addTask(simulation.CreateNewTask("task", round(INNER * 1e9)))
    craft = _dry_hub(params)
    tank, thrusters = _tank(), thrusterDynamicEffector.ThrusterDynamicEffector()
    for name in sorted(params.thrusters):
        thrusters.addThruster(_thruster(params, name))
    tank.addThrusterSet(thrusters)
    craft.addStateEffector(tank)
    craft.addDynamicEffector(thrusters)
    # Flow is constant between edges, for which Euler's method is exact; higher orders look past an edge.
    integrator = svIntegrators.svIntegratorEuler(craft)
    craft.setIntegrator(integrator)
    payload = messaging.THRArrayOnTimeCmdMsgPayload()
    commands = messaging.THRArrayOnTimeCmdMsg().write(payload)
    thrusters.cmdsInMsg.subscribeTo(commands)
    for model in (thrusters, tank, craft):
        simulation.AddModelToTask("task", model)
    simulation.InitializeSimulation()
    rows = []
    # The very first command would open without that delay.
    for number, times in enumerate(np.concatenate([np.zeros((1, on_times.shape[1])), on_times])):
        # Basilisk opens a step after the command and shuts at the first step that is later than the request.
        payload.OnTimeRequest = [max(float(time) - 0.5 * INNER, 0.0) for time in times]
        commands.write(payload, round(number * STEP * 1e9))
        simulation.ConfigureStopTime(round((number + 1) * STEP * 1e9))
        simulation.ExecuteSimulation()
        found = craft.scMassOutMsg.read()
        rows.append((found.massSC, np.array(found.c_B), np.array(found.ISC_PntB_B)))
    mass, center, about_origin = (np.array(each[1:]) for each in zip(*rows, strict=True))
    return mass, center, about_origin - mass[:, None, None] * np.array([_parallel_axis(each) for each in center])


def _parallel_axis(place: np.ndarray) -> np.ndarray:
    return place @ place * np.eye(3) - np.outer(place, place)


def _dry_hub(params: PlantParams) -> spacecraft.Spacecraft:
    """The full servicer without its propellant; the origin is the centre of mass of the full one."""
    full, inertia = float(params.servicer.mass), np.asarray(params.servicer.inertia)
    dry = full - PROPELLANT
    center = -PROPELLANT * TANK / dry
    at_origin = inertia - PROPELLANT * (0.4 * RADIUS**2 * np.eye(3) + _parallel_axis(TANK))
    craft = spacecraft.Spacecraft()
    craft.hub.mHub = dry
    craft.hub.r_BcB_B = center.tolist()
    craft.hub.IHubPntBc_B = (at_origin - dry * _parallel_axis(center)).tolist()
    return craft


def _tank() -> fuelTank.FuelTank:
    tank, model = fuelTank.FuelTank(), fuelTank.FuelTankModelUniformBurn()
    model.propMassInit = model.maxFuelMass = PROPELLANT
    # A cylinder whose moments are those of the sphere about all axes.
    model.radiusTankInit = float(np.sqrt(0.8) * RADIUS)
    model.lengthTank = float(np.sqrt(2.4) * RADIUS)
    model.r_TcT_TInit = [0.0, 0.0, 0.0]
    tank.setTankModel(model)
    tank.setR_TB_B(TANK.tolist())
    tank.setNameOfMassState("propellant")
    return tank


def _thruster(params: PlantParams, name: str) -> thrusterDynamicEffector.THRSimConfig:
    given = params.thrusters[name]
    config = thrusterDynamicEffector.THRSimConfig()
    config.thrLoc_B = np.asarray(given.position).tolist()
    config.thrDir_B = np.asarray(given.direction / jnp.linalg.norm(given.direction)).tolist()
    config.MaxThrust = float(given.force)
    config.steadyIsp = float(given.isp)
    config.MinOnTime = 0.0
    return config


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rpojax.prepare_process()
    params, truth = vehicle()
    rng = np.random.default_rng(options.seed)
    # Less than a whole step, as Basilisk opens late by one of its own.
    on_times = INNER * rng.integers(0, round(STEP / INNER), (options.steps, len(params.thrusters)))
    ours, theirs = by_rpojax(params, truth, on_times), by_basilisk(params, on_times)
    full = float(params.servicer.mass)
    pairs = {
        "propellant used": (full - ours[0], full - theirs[0]),
        "centre of mass": (ours[1], theirs[1]),
        "inertia": (ours[2], theirs[2]),
    }
    print(f"{options.steps} steps of {STEP} s, {full - theirs[0][-1]:.3f} kg of {PROPELLANT} kg used")
    for name, (own, other) in pairs.items():
        difference = np.abs(own - other).reshape(len(own), -1).max(axis=1)
        size = np.abs(other).reshape(len(other), -1).max(axis=1)
        print(f"{name}: greatest relative difference {np.max(difference / size):.1e}")


if __name__ == "__main__":
    main()
