"""Figures of the packaged target's field; each part prints the rows of a table for the README.

python experiments/radiance_field/measure.py quality|ranges|phase|speed|compare|recovery|strips
"""

import argparse
import dataclasses
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import optax

from rpojax.core import quaternion
from rpojax.training import judge, raytrace, target_mesh, train_field
from rpojax.vision.field import Field
from rpojax.vision.pinhole import lens
from rpojax.vision.region import Sampling, sampling
from rpojax.vision.render import render_frame
from rpojax.vision.weights import load_field

HERE = Path(__file__).parent
OUT = Path("out/radiance_field")
BARS = {"psnr_db": 32.0, "psnr_target_db": 23.5, "ssim": 0.955, "silhouette_iou": 0.98, "box_iou_median": 0.95}
SEED = 1001


def fresh_views(count: int = 64, samples: int = 256, **changes: Any) -> raytrace.Views:
    """Views that no training has seen."""
    shell = raytrace.Shell(count, samples=samples, seed=SEED, **changes)
    name = "_".join(f"{key}{value}" for key, value in changes.items())
    return raytrace.render(target_mesh.packaged(), shell, OUT / f"test_{name}")


def quality(field: Field) -> None:
    """The figures that the packaged field must reach."""
    views = fresh_views()
    found = judge.figures(judge.pictures(field, views), views)
    rows = judge.per_view(judge.pictures(field, views), views)
    boxes = np.array([judge.silhouette_box(alpha) for alpha in views.alpha])
    width = np.max(boxes[:, 2:] - boxes[:, :2], axis=1).mean() / views.alpha.shape[1]
    print(f"target's long side: {width:.0%} of the frame, mean over views")
    print("| figure | must | all pixels together | mean over views |\n|---|---|---|---|")
    for name, bar in BARS.items():
        other = "box_iou" if name == "box_iou_median" else name
        print(f"| `{name}` | {bar:g} | {found[name]:.4g} | {rows[other].mean():.4g} |")


def ranges(field: Field) -> None:
    """Boxes in the 10 deg, 128 px camera by range."""
    print("| range [m] | target [px] | box IoU, median | p5 | PSNR [dB] | silhouette IoU |\n|---|---|---|---|---|---|")
    for range_m in (10.0, 20.0, 30.0, 35.0, 50.0, 80.0):
        views = fresh_views(40, 128, range_m=range_m, field_of_view_deg=10.0)
        rows = judge.per_view(judge.pictures(field, views), views)
        boxes = np.array([judge.silhouette_box(alpha) for alpha in views.alpha])
        long_px = np.max(boxes[:, 2:] - boxes[:, :2], axis=1).mean()
        iou = rows["box_iou"]
        print(
            f"| {range_m:.0f} | {long_px:.1f} | {np.median(iou):.3f} | {np.percentile(iou, 5):.3f} "
            f"| {rows['psnr_db'].mean():.1f} | {rows['silhouette_iou'].mean():.3f} |"
        )


def phase(field: Field) -> None:
    """Error by phase angle."""
    views = fresh_views()
    rows = judge.per_view(judge.pictures(field, views), views)
    middle = target_mesh.packaged().bounds.mean(axis=0)
    away = views.position - middle
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(np.sum(away * views.sun, axis=1), -1.0, 1.0)))
    print("| phase angle [deg] | views | PSNR [dB] | on the target [dB] | SSIM |\n|---|---|---|---|---|")
    for low, high in ((0, 30), (30, 60), (60, 90), (90, 110)):
        chosen = (angle >= low) & (angle < high)
        if chosen.any():
            values = [np.mean(rows[name][chosen]) for name in ("psnr_db", "psnr_target_db", "ssim")]
            print(f"| {low} to {high} | {chosen.sum()} | {values[0]:.1f} | {values[1]:.1f} | {values[2]:.3f} |")


def frame_time(field: Field, region: int = 64, batch: int = 8) -> float:
    """Milliseconds for a frame of `region` x `region` rays within a batch: shortest of several calls."""
    optics = lens(jnp.asarray(np.radians(10.0)), 128, 128)
    rotations, positions, suns = raytrace.draw(target_mesh.packaged(), raytrace.Shell(batch, range_m=30.0))
    lit = jnp.ones((), jnp.float32)
    share = sampling(field, float(optics.focal_px), 30.0)
    rays = Sampling(region, math.ceil(region * region * share.rays / share.side**2))

    def one(field: Field, position: jax.Array, rotation: jax.Array, sun: jax.Array) -> tuple[jax.Array, jax.Array]:
        frame = render_frame(field, optics, 128, 128, rays, position, rotation, sun, lit)
        return frame.color, frame.alpha

    run = jax.jit(jax.vmap(one, in_axes=(None, 0, 0, 0)))
    poses = [jnp.asarray(values, jnp.float32) for values in (positions, rotations, suns)]
    return 1e3 / batch * shortest(lambda: run(field, *poses))


def shortest(call: Callable[[], Any], times: int = 7) -> float:
    """Shortest wall-clock time [s] of several calls after one that compiles."""
    jax.block_until_ready(call())
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        jax.block_until_ready(call())
        spent.append(time.perf_counter() - start)
    return min(spent)


def speed(field: Field) -> None:
    """Time of a frame."""
    print("| region [rays] | batch | ms a frame |\n|---|---|---|")
    for region in (32, 64, 96):
        print(f"| {region} x {region} | 8 | {frame_time(field, region):.1f} |")
    if jax.default_backend() != "cpu":
        print(f"| 64 x 64 | 256 | {frame_time(field, 64, 256):.3f} |")


def compare(field: Field) -> None:
    """Both fields, trained on the same views in this run: error against training time and against render time."""
    del field
    mesh = target_mesh.packaged()
    views = raytrace.render(mesh, raytrace.Shell(300, range_scale=(0.9, 1.15)), OUT / "train")
    judged = fresh_views()
    print("| field | training [s] | steps | ms a frame, 64 x 64 | PSNR [dB] | on the target [dB] | silhouette IoU |")
    print("|---|---|---|---|---|---|---|")
    for kind in ("grid", "point"):
        for limit_s in (60.0, 120.0):
            recipe = train_field.Recipe(steps=4000 if kind == "grid" else 1000, kind=kind, limit_s=limit_s)
            trained, history = train_field.train(mesh, views, recipe)
            found = judge.figures(judge.pictures(trained, judged), judged)
            print(
                f"| {kind} | {history[-1].elapsed_s:.0f} | {history[-1].done} | {frame_time(trained, 64, 2):.1f} "
                f"| {found['psnr_db']:.1f} | {found['psnr_target_db']:.1f} | {found['silhouette_iou']:.3f} |",
                flush=True,
            )


def recovery(field: Field) -> None:
    """A pose 3 deg and 3 % of range wrong, mended by the gradient of a silhouette loss; a picture of both."""
    print("| view | turn wrong by, start and end [deg] | range wrong by, start and end [%] |\n|---|---|---|")
    strips = []
    for seed in range(4):
        found = recover(field, seed)
        turn, scale = found["turn_deg"], found["range_percent"]
        print(f"| {seed} | {turn[0]:.2f}, {turn[1]:.2f} | {scale[0]:.2f}, {scale[1]:.2f} |")
        strips.append(np.concatenate(found["pictures"], axis=1))
    save(HERE / "pose_recovery.png", np.concatenate(strips, axis=0), 3)


def recover(field: Field, seed: int, steps: int = 100) -> dict[str, Any]:
    """Errors before and after `steps` of descent, and pictures of where both silhouettes are and agree."""
    mesh = target_mesh.packaged()
    views = raytrace.draw(mesh, raytrace.Shell(1, seed=77 + seed))
    rotation, position, sun = (jnp.asarray(values[0], jnp.float32) for values in views)
    optics = lens(jnp.asarray(np.radians(26.0)), 64, 64)
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    wrong = jnp.asarray(np.concatenate([np.radians(3.0) * axis / np.linalg.norm(axis), [0.03]]), jnp.float32)

    def silhouette(error: jax.Array) -> jax.Array:
        R_KT, r = moved(rotation, position, error)
        return render_frame(field, optics, 64, 64, Sampling.whole(64), r, R_KT, sun, jnp.ones((), jnp.float32)).alpha

    wanted = jax.jit(silhouette)(jnp.zeros(4, jnp.float32))
    slope = jax.jit(jax.value_and_grad(lambda error: jnp.mean((silhouette(error) - wanted) ** 2)))
    optimiser = optax.adam(4e-3)
    error, state = wrong, optimiser.init(wrong)
    for step in range(steps):
        with jax.numpy_dtype_promotion("standard"):  # optax raises a number to the power of its count
            change, state = optimiser.update(slope(error)[1], state)
        error = error + (0.5 + 0.49 * math.cos(math.pi * step / steps)) * cast(jax.Array, change)
    shown = [
        np.stack([np.asarray(s), np.asarray(wanted), np.asarray(wanted)], axis=2)
        for s in map(silhouette, (wrong, error))
    ]
    return {
        "turn_deg": [float(np.degrees(np.linalg.norm(e[:3]))) for e in (wrong, error)],
        "range_percent": [100.0 * float(abs(e[3])) for e in (wrong, error)],
        "pictures": shown,
    }


def moved(rotation: jax.Array, position: jax.Array, error: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Camera axes and position when the target is turned by `error[:3]` [rad] and its range is `error[3]` too long."""
    turn = quaternion.to_matrix(quaternion.exp(error[:3]))
    R_KT = jnp.sum(rotation[:, :, None] * turn[None, :, :], axis=1)
    return R_KT, jnp.sum(turn * position[:, None], axis=0) * (1.0 + error[3])


def strips(field: Field) -> None:
    """Ray trace, field and difference side by side, at the nominal range and in the 10 deg camera."""
    views = fresh_views()
    chosen = np.arange(0, 64, 8)
    views = take(views, chosen)
    shown = judge.pictures(field, views)
    error = np.abs(judge.codes(shown.rgb) - judge.codes(views.rgb))
    save(HERE / "strip.png", sheet(views.rgb, shown.rgb, error), 1)
    far = take(fresh_views(40, 128, range_m=30.0, field_of_view_deg=10.0), np.arange(0, 40, 5))
    shown = judge.pictures(field, far)
    error = np.abs(judge.codes(shown.rgb) - judge.codes(far.rgb))
    save(HERE / "strip_30m.png", sheet(far.rgb, shown.rgb, error), 1)


def take(views: raytrace.Views, chosen: np.ndarray) -> raytrace.Views:
    """Some of the views."""
    names = ("rotation", "position", "sun", "rgb", "alpha", "depth")
    return dataclasses.replace(views, **{name: getattr(views, name)[chosen] for name in names})


def sheet(*rows: np.ndarray) -> np.ndarray:
    """Rows of pictures as one (h, w, 3) array of codes."""
    return np.concatenate([np.concatenate(list(judge.codes(row)), axis=1) for row in rows], axis=0)


def save(path: Path, picture: np.ndarray, scale: int) -> None:
    """Writes a picture (codes 0..1, RGB), enlarged."""
    pixels = np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)[..., ::-1]
    cv2.imwrite(str(path), cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST))


PARTS = {part.__name__: part for part in (quality, ranges, phase, speed, compare, recovery, strips)}


def main() -> int:
    """Prints the part asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=list(PARTS))
    parser.add_argument("--field", type=Path, default=None)
    arguments = parser.parse_args()
    field, _ = load_field(arguments.field)
    PARTS[arguments.part](field)
    return 0


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    raise SystemExit(main())
