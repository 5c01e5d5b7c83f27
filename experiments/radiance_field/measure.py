"""Measurements of the radiance field of the packaged target; each part prints a table for the README.

python experiments/radiance_field/measure.py quality|ranges|phase|speed|compare|recovery|strips
python experiments/radiance_field/measure.py meshes "hubble.glb --center" "parts.stl --units mm --center"
"""

import argparse
import dataclasses
import json
import math
import os
import resource
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import optax

from rpojax.core import quaternion
from rpojax.training.radiance_field import evaluate_field, train_field
from rpojax.training.synthetic_data import random_views, ray_traced_views
from rpojax.training.synthetic_data.meshes import packaged_target
from rpojax.vision.pinhole import pinhole_intrinsics
from rpojax.vision.radiance_field.field_file import load_field
from rpojax.vision.radiance_field.ray_budget import RaySampling, choose_ray_sampling
from rpojax.vision.radiance_field.render_image import Light, render_target
from rpojax.vision.radiance_field.target_field import RadianceField

HERE = Path(__file__).parent
OUT = Path("out/radiance_field")
REQUIRED = {"psnr_db": 32.0, "psnr_target_db": 23.5, "ssim": 0.955, "silhouette_iou": 0.98, "box_iou_median": 0.95}
SEED = 1001
POSE_RAYS = RaySampling(64, 2048)
STEPS = {"grid": 2000, "point": 750}
"""Steps of the two trainings that are compared."""


def fresh_views(count: int = 64, samples: int = 256, **changes: Any) -> ray_traced_views.Views:
    """Views that are not in any training."""
    view_sampling = random_views.ViewSampling(count, samples=samples, seed=SEED, **changes)
    name = "_".join(f"{key}{value}" for key, value in changes.items())
    return ray_traced_views.ray_trace_views(packaged_target.packaged_target(), view_sampling, OUT / f"test_{name}")


def quality(field: RadianceField) -> None:
    """Metrics of the packaged field with their requirements."""
    views = fresh_views()
    found = evaluate_field.field_metrics(evaluate_field.render_views(field, views), views)
    rows = evaluate_field.metrics_per_view(evaluate_field.render_views(field, views), views)
    boxes = np.array([evaluate_field.silhouette_box(alpha) for alpha in views.alpha])
    width = np.max(boxes[:, 2:] - boxes[:, :2], axis=1).mean() / views.alpha.shape[1]
    print(f"target's long side: {width:.0%} of the frame, mean over views")
    print("| metric | required | all pixels together | mean over views |\n|---|---|---|---|")
    for name, required in REQUIRED.items():
        other = "box_iou" if name == "box_iou_median" else name
        print(f"| `{name}` | {required:g} | {found[name]:.4g} | {rows[other].mean():.4g} |")


def ranges(field: RadianceField) -> None:
    """Boxes in the 10 deg, 128 px camera by range."""
    print("| range [m] | target [px] | box IoU, median | p5 | PSNR [dB] | silhouette IoU |\n|---|---|---|---|---|---|")
    for range_m in (10.0, 20.0, 30.0, 35.0, 50.0, 80.0):
        views = fresh_views(40, 128, range_m=range_m, field_of_view_deg=10.0)
        rows = evaluate_field.metrics_per_view(evaluate_field.render_views(field, views), views)
        boxes = np.array([evaluate_field.silhouette_box(alpha) for alpha in views.alpha])
        long_px = np.max(boxes[:, 2:] - boxes[:, :2], axis=1).mean()
        iou = rows["box_iou"]
        print(
            f"| {range_m:.0f} | {long_px:.1f} | {np.median(iou):.3f} | {np.percentile(iou, 5):.3f} "
            f"| {rows['psnr_db'].mean():.1f} | {rows['silhouette_iou'].mean():.3f} |"
        )


def phase(field: RadianceField) -> None:
    """Error by phase angle."""
    views = fresh_views()
    rows = evaluate_field.metrics_per_view(evaluate_field.render_views(field, views), views)
    center = packaged_target.packaged_target().bounds.mean(axis=0)
    away = views.position - center
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(np.sum(away * views.sun, axis=1), -1.0, 1.0)))
    print("| phase angle [deg] | views | PSNR [dB] | on the target [dB] | SSIM |\n|---|---|---|---|---|")
    for low, high in ((0, 30), (30, 60), (60, 90), (90, 110)):
        chosen = (angle >= low) & (angle < high)
        if chosen.any():
            values = [np.mean(rows[name][chosen]) for name in ("psnr_db", "psnr_target_db", "ssim")]
            print(f"| {low} to {high} | {chosen.sum()} | {values[0]:.1f} | {values[1]:.1f} | {values[2]:.3f} |")


def frame_time(field: RadianceField, region: int = 64, batch: int = 8) -> float:
    """Milliseconds for a frame of `region` x `region` rays within a batch: shortest of several calls."""
    intrinsics = pinhole_intrinsics(jnp.asarray(np.radians(10.0)), 128, 128)
    views = random_views.sample_views(packaged_target.packaged_target(), random_views.ViewSampling(batch, range_m=30.0))
    nominal = choose_ray_sampling(field, float(intrinsics.focal_px), 30.0)
    rays = RaySampling(region, math.ceil(region * region * nominal.ray_count / nominal.side**2))

    def one(
        field: RadianceField, position: jax.Array, rotation: jax.Array, sun: jax.Array, fill: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        frame = render_target(field, intrinsics, 128, 128, rays, position, rotation, in_light(sun, fill))
        return frame.color, frame.alpha

    run = jax.jit(jax.vmap(one, in_axes=(None, 0, 0, 0, 0)))
    parts = (views.position, views.rotation, views.sun, views.fill)
    poses = [jnp.asarray(values, jnp.float32) for values in parts]
    return 1e3 / batch * shortest(lambda: run(field, *poses))


def in_light(sun: jax.Array, fill: jax.Array) -> Light:
    """Light of the Sun and of the Earth in the morning, from their directions in T."""
    fill_light = jnp.float32(evaluate_field.FILL_LIGHT)
    return Light(sun_T=sun, sunlight=jnp.float32(1.0), fill_T=fill, fill=fill_light)


def shortest(call: Callable[[], Any], times: int = 7) -> float:
    """Shortest wall-clock time [s] of several calls after one that compiles."""
    jax.block_until_ready(call())
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        jax.block_until_ready(call())
        spent.append(time.perf_counter() - start)
    return min(spent)


def speed(field: RadianceField) -> None:
    """Time of a frame."""
    print("| region [rays] | batch | ms per image |\n|---|---|---|")
    for region in (32, 64, 96):
        print(f"| {region} x {region} | 8 | {frame_time(field, region):.1f} |")
    if jax.default_backend() != "cpu":
        print(f"| 64 x 64 | 256 | {frame_time(field, 64, 256):.3f} |")


def compare(field: RadianceField) -> None:
    """Grid field and NeRF trained on the same views: error against training time and rendering time."""
    del field
    mesh = packaged_target.packaged_target()
    views = ray_traced_views.ray_trace_views(
        mesh, random_views.ViewSampling(300, range_scale=(0.9, 1.15)), OUT / "train"
    )
    validation = fresh_views()
    final = []
    print("| field | steps | training [s] | of processors [s] | PSNR near the target, validation views [dB] |")
    print("|---|---|---|---|---|")
    for kind, steps in STEPS.items():
        trained, _ = train_field.train(
            mesh, views, train_field.FieldTrainingOptions(steps=steps, kind=kind), on_progress=progress_printer(kind)
        )
        found = evaluate_field.field_metrics(evaluate_field.render_views(trained, validation), validation)
        final.append(
            f"| {kind} | {frame_time(trained, 64):.1f} | {found['psnr_db']:.1f} | {found['psnr_target_db']:.1f} "
            f"| {found['ssim']:.3f} | {found['silhouette_iou']:.3f} |"
        )
    print("\n| field | ms per image, 64 x 64 | PSNR [dB] | on the target [dB] | SSIM | silhouette IoU |")
    print("|---|---|---|---|---|---|", *final, sep="\n")


def meshes(commands: list[str]) -> None:
    """Other meshes, each trained and evaluated by the command line with default settings."""
    print(
        "| mesh | faces | training command [s] | of processors [s] | load | PSNR [dB] | on the target [dB] | SSIM "
        "| silhouette IoU |\n|---|---|---|---|---|---|---|---|---|"
    )
    for words in map(shlex.split, commands):
        path = OUT / f"{Path(words[0]).stem}{Path(words[0]).suffix}.field"
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        made = run_field_command("train", *words, "--out", str(path), "--force")
        wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        found = run_field_command("evaluate", str(path), "--mesh", *words, "--views", "64", "--seed", "7")
        name, load = " ".join([Path(words[0]).name, *words[1:]]), os.getloadavg()[0]
        print(
            f"| {name} | {made['faces']} | {wall:.0f} | {spent:.0f} | {load:.0f} | {found['psnr_db']:.1f} "
            f"| {found['psnr_target_db']:.1f} | {found['ssim']:.3f} | {found['silhouette_iou']:.3f} |",
            flush=True,
        )


def run_field_command(*words: str) -> dict[str, Any]:
    """JSON output of a command of `rpojax field`."""
    done = subprocess.run([sys.executable, "-m", "rpojax", "field", *words, "--json"], check=True, capture_output=True)
    return json.loads(done.stdout)


def progress_printer(kind: str) -> train_field.OnFieldProgress:
    """Callback that prints a row for every check of a training that starts now."""
    start = time.process_time()

    def show(step: train_field.FieldTrainingProgress) -> None:
        spent = time.process_time() - start
        print(f"| {kind} | {step.done} | {step.elapsed_s:.0f} | {spent:.0f} | {step.psnr_db:.1f} |", flush=True)

    return show


def recovery(field: RadianceField) -> None:
    """Pose recovery by the gradient of a silhouette loss, from errors of 3 deg and 3 % of range; with a figure."""
    print(
        "| view | measured by | attitude error, start and end [deg] | range error, start and end [%] |\n"
        "|---|---|---|---|"
    )
    rendered = []
    for seed in range(4):
        for name, measured in (("field", None), ("ray trace", traced_silhouette(seed))):
            found = recover_pose(field, seed, measured)
            turn, scale = found.turn_deg, found.range_percent
            print(f"| {seed} | {name} | {turn[0]:.2f}, {turn[1]:.2f} | {scale[0]:.2f}, {scale[1]:.2f} |", flush=True)
            if measured is None:
                rendered.append(found)
    plot_recovery(HERE / "pose_recovery.png", field, rendered)


@dataclasses.dataclass(frozen=True)
class PoseRecovery:
    """A view, and errors of its pose (rotation vector [rad], relative range) at the start and at the end."""

    view: tuple[jax.Array, jax.Array, jax.Array]
    errors: tuple[jax.Array, jax.Array]

    @property
    def turn_deg(self) -> list[float]:
        """Errors of attitude, start and end."""
        return [float(np.degrees(np.linalg.norm(error[:3]))) for error in self.errors]

    @property
    def range_percent(self) -> list[float]:
        """Errors of range, start and end."""
        return [100.0 * float(abs(error[3])) for error in self.errors]


def pose_view_sampling(seed: int, **changes: Any) -> random_views.ViewSampling:
    """Sampling of the view whose pose is recovered."""
    return random_views.ViewSampling(1, seed=77 + seed, size_px=64, **changes)


def traced_silhouette(seed: int) -> jax.Array:
    """Ray-traced silhouette (64, 64) of that view."""
    return jnp.asarray(
        ray_traced_views.ray_trace_views(
            packaged_target.packaged_target(), pose_view_sampling(seed, samples=256)
        ).alpha[0]
    )


def silhouette(
    field: RadianceField, view: tuple[jax.Array, ...], error: jax.Array, rays: RaySampling, size: int
) -> jax.Array:
    """Alpha (size, size) of a view whose pose has an error."""
    rotation, position, sun = view
    intrinsics = pinhole_intrinsics(jnp.asarray(np.radians(random_views.FIELD_OF_VIEW_DEG)), size, size)
    R_KT, r = perturbed_pose(rotation, position, error)
    return render_target(field, intrinsics, size, size, rays, r, R_KT, in_light(sun, -sun)).alpha


@partial(jax.jit, static_argnums=(4,))
def silhouette_gradient(
    field: RadianceField, view: tuple[jax.Array, ...], measured: jax.Array, error: jax.Array, rays: RaySampling
) -> jax.Array:
    """Gradient of the silhouette's mean squared error in the pose's error."""
    return jax.grad(lambda e: jnp.mean((silhouette(field, view, e, rays, 64) - measured) ** 2))(error)


def recover_pose(
    field: RadianceField, seed: int, measured: jax.Array | None = None, steps: int = 100, rays: RaySampling = POSE_RAYS
) -> PoseRecovery:
    """Gradient descent from a pose error of 3 deg and 3 % to a silhouette (64, 64), by default that of the field."""
    sampled = random_views.sample_views(packaged_target.packaged_target(), pose_view_sampling(seed))
    rotation, position, sun = (
        jnp.asarray(values[0], jnp.float32) for values in (sampled.rotation, sampled.position, sampled.sun)
    )
    view = (rotation, position, sun)
    axis = np.random.default_rng(seed).normal(size=3)
    wrong = jnp.asarray(np.concatenate([np.radians(3.0) * axis / np.linalg.norm(axis), [0.03]]), jnp.float32)
    if measured is None:
        render_silhouette = jax.jit(lambda field, view: silhouette(field, view, jnp.zeros(4, jnp.float32), rays, 64))
        measured = render_silhouette(field, view)
    optimiser = optax.adam(4e-3)
    error, state = wrong, optimiser.init(wrong)
    for step in range(steps):
        with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer power
            change, state = optimiser.update(silhouette_gradient(field, view, measured, error, rays), state)
        error = error + (0.5 + 0.49 * math.cos(math.pi * step / steps)) * cast(jax.Array, change)
    return PoseRecovery(view, (wrong, error))


def plot_recovery(path: Path, field: RadianceField, found: list[PoseRecovery], size: int = 192) -> None:
    """Superposed silhouettes before and after, one column per view."""
    from matplotlib import pyplot
    from matplotlib.patches import Patch

    render_silhouette = jax.jit(lambda view, error: silhouette(field, view, error, RaySampling(256, 256 * 128), size))
    figure, axes = pyplot.subplots(2, len(found), figsize=(2.2 * len(found), 5.2), layout="constrained")
    for column, one in enumerate(found):
        measured = np.asarray(render_silhouette(one.view, jnp.zeros(4, jnp.float32)))
        for row, (name, error) in enumerate(zip(("start", "after 100 steps"), one.errors, strict=True)):
            axis = axes[row, column]
            axis.imshow(overlay(measured, np.asarray(render_silhouette(one.view, error))), interpolation="nearest")
            axis.set_title(
                f"view {column}, {name}\n{one.turn_deg[row]:.2f} deg, {one.range_percent[row]:.2f} %", fontsize=9
            )
            axis.set_axis_off()
    meanings = (("both", _BOTH), ("measured only", _MEASURED), ("assumed pose only", _ASSUMED))
    handles = [Patch(facecolor=color, edgecolor="black", label=name) for name, color in meanings]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle("Silhouettes: where they agree, and errors of attitude and range", fontsize=10)
    figure.savefig(path, dpi=110)


_BOTH, _MEASURED, _ASSUMED = (0.72, 0.75, 0.78), (0.0, 0.45, 0.70), (0.84, 0.37, 0.0)


def overlay(measured: np.ndarray, assumed: np.ndarray) -> np.ndarray:
    """Image (p, p, 3) of two silhouettes on white."""
    shares = (np.minimum(measured, assumed), measured - assumed, assumed - measured)
    parts = [np.clip(share, 0.0, 1.0)[..., None] for share in shares]
    colors = [np.array(color) for color in (_BOTH, _MEASURED, _ASSUMED)]
    return 1.0 - np.sum([part * (1.0 - color) for part, color in zip(parts, colors, strict=True)], axis=0)


def perturbed_pose(rotation: jax.Array, position: jax.Array, error: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Camera axes and position after a rotation `error[:3]` [rad] of the target and a relative range error."""
    turn = quaternion.to_matrix(quaternion.exp(error[:3]))
    R_KT = jnp.sum(rotation[:, :, None] * turn[None, :, :], axis=1)
    return R_KT, jnp.sum(turn * position[:, None], axis=0) * (1.0 + error[3])


def strips(field: RadianceField) -> None:
    """Ray trace, field and difference side by side, at the nominal range and in the 10 deg camera."""
    views = fresh_views()
    chosen = np.arange(0, 64, 8)
    views = select_views(views, chosen)
    rendered = evaluate_field.render_views(field, views)
    error = np.abs(
        evaluate_field.srgb_codes(rendered.rgb) - evaluate_field.srgb_codes(views.radiance(evaluate_field.FILL_LIGHT))
    )
    save(HERE / "strip.png", sheet(views.radiance(evaluate_field.FILL_LIGHT), rendered.rgb, error), 1)
    far = select_views(fresh_views(40, 128, range_m=30.0, field_of_view_deg=10.0), np.arange(0, 40, 5))
    rendered = evaluate_field.render_views(field, far)
    error = np.abs(
        evaluate_field.srgb_codes(rendered.rgb) - evaluate_field.srgb_codes(far.radiance(evaluate_field.FILL_LIGHT))
    )
    save(HERE / "strip_30m.png", sheet(far.radiance(evaluate_field.FILL_LIGHT), rendered.rgb, error), 1)


def select_views(views: ray_traced_views.Views, chosen: np.ndarray) -> ray_traced_views.Views:
    """Some of the views."""
    names = ("rotation", "position", "sun", "fill", "sunlit", "filled", "alpha", "depth")
    return dataclasses.replace(views, **{name: getattr(views, name)[chosen] for name in names})


def sheet(*rows: np.ndarray) -> np.ndarray:
    """Rows of images as one (h, w, 3) array of codes."""
    return np.concatenate([np.concatenate(list(evaluate_field.srgb_codes(row)), axis=1) for row in rows], axis=0)


def save(path: Path, picture: np.ndarray, scale: int) -> None:
    """Writes an image (codes 0..1, RGB), enlarged."""
    pixels = np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)[..., ::-1]
    cv2.imwrite(str(path), cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST))


PARTS = {part.__name__: part for part in (quality, ranges, phase, speed, compare, recovery, strips)}


def main() -> int:
    """Prints one part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=[*PARTS, "meshes"])
    parser.add_argument("meshes", nargs="*", help="for the part of that name: mesh files with their options")
    parser.add_argument("--field", type=Path, default=None)
    arguments = parser.parse_args()
    if arguments.part == "meshes":
        meshes(arguments.meshes)
        return 0
    field, _ = load_field(arguments.field)
    PARTS[arguments.part](field)
    return 0


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    raise SystemExit(main())
