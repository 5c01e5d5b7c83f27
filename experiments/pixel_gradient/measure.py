"""Derivatives of the navigation error through the picture, against central differences of the same soft program.

    python experiments/pixel_gradient/measure.py derivatives --runs 8 --seconds 120
    python experiments/pixel_gradient/measure.py differences --runs 8 --seconds 120
    python experiments/pixel_gradient/measure.py pose --runs 6
    python experiments/pixel_gradient/measure.py cost --runs 8 --seconds 120

All but the last compute pictures and networks, which are in single precision in the loop, in double precision:
differences of single precision are too coarse. `cost` is of the program as it is.
"""

import argparse
import dataclasses
import json
import resource
import time
import types
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

METRIC = "nav_relative_position_error_rms_m"
INPUTS = (
    ("imaging.exposure", None, 1e-6),
    ("imaging.detector.first.out.bias", 1, 1e-6),
    ("imaging.detector.second.out_quality.bias", 0, 1e-6),
    ("imaging.field.network.2.bias", 1, 1e-6),
    ("navigation.edge_noise_px", None, 1e-6),
)
"""Keys, components of tensors, and steps of the differences."""


def in_double_precision() -> None:
    """Makes pictures and networks of this process double; before rpojax is imported."""
    single = types.SimpleNamespace(**vars(jnp))
    jnp.float32 = jnp.float64
    from rpojax.core import random_streams
    from rpojax.scenario.trained import trained_files
    from rpojax.vision.radiance_field import field_file

    def double(tree: Any) -> Any:
        return jax.tree.map(lambda x: x.astype(jnp.float64) if x.dtype == np.float32 else x, tree)

    # Random numbers stay those of the loop, which are made from bits of single precision.
    random_streams.jnp = single
    occupied, load = field_file.with_occupancy, trained_files.load_networks
    field_file.with_occupancy = lambda field: occupied(double(field))
    trained_files.load_networks = lambda *tables: double(load(*tables))


def evaluator_of(runs: int, seconds: float, temperature: float) -> Any:
    """Evaluator of runs of `inspection` as a function of shifts of the inputs (k,)."""
    import rpojax
    from rpojax.analysis.gradients import scenario_gradient
    from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator

    file = rpojax.load("inspection", ["camera.model=rendered", f"duration_s={seconds:g}"])
    nominal = scenario_gradient._nominals_of(file, [key for key, _, _ in INPUTS])
    shifted = scenario_gradient._shifted_values(file, nominal)
    rows = []
    for key, component, _ in INPUTS:
        row = {name: np.zeros(value.size) for name, value in nominal.items()}
        row[key][component or 0] = 1.0
        rows.append(np.concatenate(list(row.values())))
    matrix = np.array(rows)
    evaluator = RolloutEvaluator(file, lambda x, key: shifted(x @ matrix, key), len(INPUTS), [METRIC], runs)
    evaluator.soften_detector(temperature)
    return evaluator


def differences(evaluator: Any, keys: np.ndarray) -> Any:
    """Function from shifts (runs, k) to metrics (runs,) of runs with pictures from the poses of undisturbed ones.

    Beside each run goes the undisturbed one. The run has the scene of that one before its camera, and its boxes are
    moved by how far its outline is from that of the other: what a derivative says of the pose.
    """
    from rpojax.analysis.gradients import trained_tensors
    from rpojax.campaign.execution.run_programs import batch_transform
    from rpojax.sensors import rendered_camera
    from rpojax.simulation import camera_models, initial_state
    from rpojax.simulation.metrics import running_metrics
    from rpojax.simulation.state import state_axes
    from rpojax.simulation.step import step

    scenario, nominal, stages = evaluator.scenario, evaluator._nominal, evaluator._stages
    scene_of, measure, seen = camera_models._scene, rendered_camera.measure, {}

    def scene(*arguments: Any) -> Any:
        return seen.setdefault("scene", scene_of(*arguments))

    def measured(imaging: Any, networks: Any, window: Any, image: Any, size: Any, outline: Any, *rest: Any) -> Any:
        undisturbed = seen.setdefault("outline", outline)
        frame = measure(imaging, networks, seen.setdefault("window", window), image, size, undisturbed, *rest)
        box = dataclasses.replace(frame.box, edges=frame.box.edges + outline - undisturbed)
        return dataclasses.replace(frame, box=box)

    def tick(values: Any, states: Any, sums: Any) -> Any:
        camera_models._scene, rendered_camera.measure = scene, measured
        seen.clear()
        after = []
        for own, state in zip(values, states, strict=True):
            params = trained_tensors.apply_to_params(nominal, own)
            state, telemetry = step(scenario, params, state, stages)
            after.append(state)
        camera_models._scene, rendered_camera.measure = scene_of, measure
        return tuple(after), running_metrics.add_tick(evaluator._metrics, scenario, params, telemetry, sums)

    axes = state_axes(-1)
    batched = batch_transform(scenario)(tick, in_axes=(-1, (axes, axes), -1), out_axes=((axes, axes), -1))

    def metrics(shift: Any) -> Any:
        pair = [jax.vmap(evaluator._input_function)(each, keys) for each in (jnp.zeros_like(shift), shift)]

        def begin(values: Any, key: Any) -> Any:
            return initial_state.init(scenario, trained_tensors.apply_to_params(nominal, values), key, stages=stages)

        states = tuple(jax.vmap(begin, out_axes=axes)(values, keys) for values in pair)
        sums = jax.vmap(lambda _: running_metrics.initial_sums(evaluator._metrics), out_axes=-1)(keys)
        last = tuple(jax.tree.map(lambda value: jnp.moveaxis(value, 0, -1), values) for values in pair)
        (states, sums), _ = jax.lax.scan(
            lambda carry, _: (batched(last, *carry), None), (states, sums), None, length=scenario.ticks
        )
        found = jax.vmap(lambda each: running_metrics.final_values(evaluator._metrics, each), in_axes=-1)(sums)
        return found[:, 0], sums.event_hash

    return jax.jit(metrics)


def check(runs: int, seconds: float, seed: int, temperature: float, part: str) -> dict[str, Any]:
    """Derivatives (part `derivatives`) or central differences of runs, by input."""
    from rpojax.simulation.noise import run_keys

    evaluator, keys = evaluator_of(runs, seconds, temperature), run_keys(seed, np.arange(runs))
    if part == "derivatives":
        here = evaluator.jacobian(np.zeros((runs, len(INPUTS))), keys)
        return {
            "metric": here.metrics[:, 0].tolist(),
            **{key: here.jacobian[:, 0, index].tolist() for index, (key, _, _) in enumerate(INPUTS)},
        }
    metrics = differences(evaluator, keys)
    undisturbed, events = map(np.asarray, metrics(np.zeros((runs, len(INPUTS)))))
    found: dict[str, Any] = {"metric": undisturbed.tolist()}
    for index, (key, _, step) in enumerate(INPUTS):
        shift = np.zeros((runs, len(INPUTS)))
        shift[:, index] = step
        (ahead, events_ahead), (back, events_back) = (map(np.asarray, metrics(each)) for each in (shift, -shift))
        found[key] = ((ahead - back) / (2.0 * step)).tolist()
        found[f"{key}, runs with the same events"] = int(((events_ahead == events) & (events_back == events)).sum())
        print(json.dumps({key: found[key]}), flush=True)
    return found


def pose(runs: int, seed: int, temperature: float) -> dict[str, Any]:
    """Motion of the box's centre by a turn of the camera [px/rad], at the start of runs: by derivative, by differences.

    Differences are of 1e-7, 1e-4 and 1e-3 rad; a pixel is 1.4e-3 rad. The outline's is the focal length.
    """
    import rpojax
    from rpojax.core import quaternion
    from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
    from rpojax.sensors import rendered_camera
    from rpojax.simulation import camera_models
    from rpojax.vision.detector.two_stage_detector import soft_detect

    file, found = rpojax.load("inspection", ["camera.model=rendered"]), {}
    scenario, _, state = rpojax.initialise_run(file, seed, 0)
    size = (scenario.width_px, scenario.height_px)

    def centre(turn: Any, params: Any, truth: Any) -> Any:
        change = jnp.concatenate([jnp.ones(1), 0.5 * turn])
        turned = quaternion.multiply(change / jnp.sqrt(jnp.sum(change * change)), truth.q_BN)
        truth = dataclasses.replace(truth, q_BN=turned)
        window = camera_models.commanded_window(scenario, params, state.flight.camera)
        sky = sun_and_moon_at(params.epoch, jnp.zeros(()))
        scene = camera_models._scene(scenario, params, truth, sky, jnp.zeros((), jnp.int64))
        rays, key = scenario.ray_sampling, jax.random.PRNGKey(3)
        picture = rendered_camera.render_window(params.imaging, params.networks, rays, window, *size, scene, key)
        box, _ = soft_detect(params.networks.detector, picture, temperature, rendered_camera.REFINED_PROPOSALS)
        return 0.5 * jnp.stack([box[0] + box[2], box[1] + box[3]])

    values = jax.jit(centre)
    along = jax.jit(lambda turn, *rest: jax.jvp(lambda x: centre(x, *rest), (jnp.zeros(3),), (turn,))[1])
    for run in range(runs):
        _, params, state = rpojax.initialise_run(file, seed, run)
        for axis, part in ((2, 0), (1, 1)):
            turn, rest = jnp.eye(3)[axis], (params, state.truth)
            steps = [
                float((values(h * turn, *rest) - values(-h * turn, *rest))[part]) / (2 * h) for h in (1e-7, 1e-4, 1e-3)
            ]
            found[f"run {run}, axis {part}"] = [round(float(along(turn, *rest)[part])), *map(round, steps)]
            print(json.dumps(found[f"run {run}, axis {part}"]), flush=True)
    return found


def cost(runs: int, seconds: float, seed: int, temperature: float) -> dict[str, Any]:
    """Time to compile and to run, and memory, of values and of derivatives in both modes."""
    from rpojax.simulation.noise import run_keys

    found: dict[str, Any] = {}
    keys, zero = run_keys(seed, np.arange(runs)), np.zeros((runs, len(INPUTS)))
    works = {
        "values": lambda each: each.evaluate(zero, keys),
        "forward": lambda each: each.jacobian(zero, keys),
        "reverse": lambda each: each.gradient(zero, keys, np.ones((runs, 1))),
    }
    for name, work in works.items():
        each = evaluator_of(runs, seconds, temperature)
        begin = time.perf_counter()
        work(each)
        found[name] = {
            "compile_s": round(each.compile_s, 1),
            "run_s": round(time.perf_counter() - begin - each.compile_s, 1),
            "program_memory_mb": round(each.program_memory_bytes / 1e6),
            "peak_memory_of_process_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3),
        }
        print(json.dumps({name: found[name]}), flush=True)
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", choices=("derivatives", "differences", "pose", "cost"))
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--temperature", type=float, default=0.25)
    asked = parser.parse_args()
    settings = (asked.runs, asked.seconds, asked.seed, asked.temperature)
    if asked.work == "cost":
        found = cost(*settings)
    else:
        in_double_precision()
        is_pose = asked.work == "pose"
        found = pose(asked.runs, asked.seed, asked.temperature) if is_pose else check(*settings, asked.work)
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
