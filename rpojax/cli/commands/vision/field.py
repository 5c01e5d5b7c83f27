"""The commands of `rpojax field`: train, evaluate and render a radiance field."""

import math
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.cli.console import show_lines
from rpojax.cli.options.vision import (
    EvaluateFieldCommand,
    FreshViews,
    MeshPlacement,
    RenderFieldCommand,
    TrainFieldCommand,
    check_seed,
)
from rpojax.cli.output_paths import claim, resumable
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import items
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.training.radiance_field import evaluate_field, train_field
from rpojax.training.radiance_field.evaluate_field import RenderedViews
from rpojax.training.synthetic_data import random_views, ray_traced_views
from rpojax.training.synthetic_data.meshes import mesh_files, packaged_target, target_mesh
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.ray_traced_views import Views
from rpojax.vision.imaging import contact_sheets, video_files
from rpojax.vision.imaging.turntable import camera_azimuths, render_turntable
from rpojax.vision.radiance_field.field_file import load_field, save_field
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere

_TRAINED_GLINTS = 0.25
"""Fraction of the training's views in which a face mirrors the Sun into the camera, to `_GLINT_SPREAD_DEG`."""
_GLINT_SPREAD_DEG = 12.0
_LEAST_ALPHA = 0.02
_SHEET_LIMIT, _FILM_LIMIT = 64, 1000


def train(asked: TrainFieldCommand) -> int:
    """Does the work of the command; returns its exit status."""
    _check_training(asked.kind, asked.views, asked.steps, asked.minutes)
    check_seed(asked.seed)
    claim(asked.out, asked.force)

    target = mesh_files.load_mesh(asked.mesh, asked.placement.units, asked.placement.center)
    show_lines(f"{asked.mesh}: {note}" for note in target.notes)
    work = asked.out.with_name(asked.out.name + ".work")
    shell = random_views.ViewSampling(
        asked.views,
        range_scale=(0.9, 1.15),
        glint_fraction=_TRAINED_GLINTS,
        glint_spread_deg=_GLINT_SPREAD_DEG,
        seed=asked.seed,
    )
    recipe = train_field.FieldTrainingOptions(
        steps=asked.steps,
        seed=asked.seed,
        kind=asked.kind,
        limit_s=None if asked.minutes is None else 60.0 * asked.minutes,
    )
    preview = work / "contact_sheet.png"
    with resumable(work):
        with items("ray tracing", quiet=asked.as_json) as watch:
            traced = ray_traced_views.ray_trace_views(
                target, shell, work, watch, partial(_preview, preview, asked.as_json)
            )
        with items("training", quiet=asked.as_json, announce=True) as watch:
            field, history = train_field.train(
                target,
                traced,
                recipe,
                work / "checkpoint",
                lambda step: watch(step.done, step.total, f"{step.psnr_db:.1f} dB"),
            )
    # The record in the weights file holds no path of this machine.
    placed = (
        *(("--units", asked.placement.units) if asked.placement.units else ()),
        *(("--center",) if asked.placement.center else ()),
    )
    numbers = ("--kind", asked.kind, "--views", asked.views, "--steps", asked.steps, "--seed", asked.seed)
    command = command_line(
        "field train", Path(asked.mesh).name, "--out", asked.out.name, *placed, *numbers, plugin=None
    )
    card = train_field.model_card(target, traced, recipe, history, command)
    save_field(field, asked.out, card)
    hull = target_mesh.outline_vertices(target)
    files = {"field": str(asked.out), "bytes": asked.out.stat().st_size, "first_views": str(preview)}
    scenario = {"hull_m": hull.tolist(), "target_size_m": round(target_mesh.apparent_size(hull), 3)}
    _print_result({**files, **card, **scenario, **_mesh_notes(target)}, asked.as_json)
    return 0


def evaluate(asked: EvaluateFieldCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if asked.sheet:
        claim(asked.sheet, asked.force, (".png",))

    target, network = _mesh_and_field(asked.mesh, asked.placement, asked.field)
    traced = _ray_trace_fresh_views(target, network, asked.fresh, asked.glints, asked.as_json)
    with items("rendering", quiet=asked.as_json) as watch:
        shown = evaluate_field.render_views(network, traced, watch)
    if asked.sheet:
        _compare(asked.sheet, shown, traced)
    _print_result({**evaluate_field.field_metrics(shown, traced), **_mesh_notes(target)}, asked.as_json)
    return 0


def render(asked: RenderFieldCommand) -> int:
    """Does the work of the command; returns its exit status."""
    claim(asked.out, asked.force, (".png", ".mp4"))
    still = asked.out.suffix.lower() == ".png"
    most = _SHEET_LIMIT if still else _FILM_LIMIT
    if not 1 <= asked.frames <= most or not 8 <= asked.size_px <= 2048:
        raise RpojaxError.of_argument(
            "frames, size_px", f"found {asked.frames}, {asked.size_px}, expected 1 to {most} and 8 to 2048"
        )
    if not 0.0 < math.hypot(*asked.sun) < math.inf:
        raise RpojaxError.of_argument("sun", f"found {asked.sun}, expected a direction")
    if not -89.0 <= asked.elevation_deg <= 89.0 or not math.isfinite(asked.azimuth_deg):
        found = f"{asked.elevation_deg}, {asked.azimuth_deg}"
        raise RpojaxError.of_argument(
            "elevation_deg, azimuth_deg", f"found {found}, expected -89 to 89 and a finite angle"
        )

    network, _ = load_field(asked.field)
    around = camera_azimuths(asked.frames, asked.azimuth_deg)
    with items("rendering", quiet=asked.as_json) as watch:
        pictures = _counted(
            render_turntable(network, around, asked.size_px, np.array(asked.sun), asked.elevation_deg),
            asked.frames,
            watch,
        )
        if still:
            captions = [f"azimuth {azimuth:.0f} deg" for azimuth in around] if asked.frames > 1 else []
            columns = min(8, math.ceil(math.sqrt(asked.frames)))
            content = contact_sheets.contact_sheet_png(np.stack(list(pictures)), columns, captions)
        else:
            content = video_files.video_mp4(pictures, asked.size_px)
    write_atomically(asked.out, content)
    _print_result({"file": str(asked.out), "frames": asked.frames, "bytes": len(content)}, asked.as_json)
    return 0


def _mesh_and_field(mesh: str | None, placement: MeshPlacement, field: Path | None) -> tuple[TargetMesh, RadianceField]:
    network, card = load_field(field)
    trained_on = card.get("target")
    if mesh is None and trained_on != packaged_target.PACKAGED_TARGET:
        raise RpojaxError.of_argument("mesh", f"missing, expected the mesh that {field} was trained on, {trained_on!r}")
    target = mesh_files.load_mesh(mesh or packaged_target.PACKAGED_TARGET, placement.units, placement.center)
    show_lines(f"{mesh}: {note}" for note in target.notes)
    _check_same(target, network)
    return target, network


def _mesh_notes(mesh: TargetMesh) -> dict[str, Any]:
    """What of a mesh file is not used, if there is anything."""
    return {"mesh_notes": list(mesh.notes)} if mesh.notes else {}


def _check_same(mesh: TargetMesh, field: RadianceField) -> None:
    """Raises `RpojaxError` if a mesh and a field differ in place or size: another mesh, or other units."""
    low, high = mesh.bounds
    middle, radius = (np.asarray(value) for value in bounding_sphere(field))
    size = 0.5 * float(np.linalg.norm(high - low))
    if not 0.8 < radius / size < 1.3 or np.linalg.norm(middle - 0.5 * (low + high)) > 0.1 * size:
        found = f"{mesh.name} with a span of {float((high - low).max()):.3g} m"
        raise RpojaxError.of_argument(
            "mesh, units, center", f"found {found}, expected the mesh of the field in its place"
        )


def _ray_trace_fresh_views(
    mesh: TargetMesh,
    field: RadianceField,
    fresh: FreshViews,
    glints: bool,
    quiet: bool,
) -> Views:
    radius = random_views.center_and_radius(mesh.bounds)[1]
    least = 1.02 * max(radius, float(bounding_sphere(field)[1]))
    distance = random_views.nominal_range(radius, fresh.fov_deg) if fresh.range_m is None else fresh.range_m
    if not distance > least:
        how = "fov_deg" if fresh.range_m is None else "range_m"
        raise RpojaxError.of_argument(
            how, f"found a range of {distance:.3g} m, expected the camera outside of {least:.3g} m"
        )
    # Training uses the seed itself, so these views are independent of it.
    shell = random_views.ViewSampling(
        fresh.views,
        samples=fresh.samples,
        seed=1_000_003 + fresh.seed,
        range_m=fresh.range_m,
        field_of_view_deg=fresh.fov_deg,
        glint_fraction=float(glints),
    )
    with items("ray tracing", quiet=quiet) as watch:
        traced = ray_traced_views.ray_trace_views(mesh, shell, None, watch)
    if not (traced.alpha > _LEAST_ALPHA).any():
        raise RpojaxError.of_argument(
            "range_m, fov_deg", "found views in which the target covers no pixel, expected a nearer one"
        )
    return traced


def _check_training(kind: str, views: int, steps: int, minutes: float | None) -> None:
    """Raises `RpojaxError` on options outside of their ranges."""
    if kind not in ("grid", "point"):
        raise RpojaxError.of_argument("kind", f"found {kind!r}, expected 'grid' or 'point'")
    if views < 16 or steps < 50:
        raise RpojaxError.of_argument(
            "views, steps", f"found {views}, {steps}, expected at least 16 views and 50 steps"
        )
    if minutes is not None and not minutes > 0.0:
        raise RpojaxError.of_argument("minutes", f"found {minutes}, expected more than 0")


def _preview(path: Path, quiet: bool, rgb: np.ndarray, alpha: np.ndarray) -> None:
    write_atomically(path, contact_sheets.contact_sheet_png(contact_sheets.over_backdrop(rgb, alpha), columns=8))
    if not quiet:
        print(f"rpojax: first views: {path}", file=sys.stderr)


def _compare(path: Path, shown: RenderedViews, traced: Views, count: int = 8) -> None:
    """Writes a sheet of three rows: ray traces, pictures of the field, and their differences."""
    lit = traced.radiance(evaluate_field.FILL_LIGHT)
    error = np.abs(evaluate_field.srgb_codes(shown.rgb[:count]) - evaluate_field.srgb_codes(lit[:count]))
    pairs = ((lit, traced.alpha), (shown.rgb, shown.alpha))
    rows = [contact_sheets.over_backdrop(rgb[:count], alpha[:count]) for rgb, alpha in pairs]
    captions = [f"{name} {i}" for name in ("ray trace", "field", "difference") for i in range(len(error))]
    write_atomically(path, contact_sheets.contact_sheet_png(np.concatenate([*rows, error]), len(error), captions))


def _counted(pictures: Iterator[np.ndarray], total: int, watch: Callable[..., None]) -> Iterator[np.ndarray]:
    for done, picture in enumerate(pictures, start=1):
        watch(done, total)
        yield picture


def _print_result(content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(content)
        return
    for name, value in content.items():
        print(f"{name}: {value:.4g}" if isinstance(value, float) else f"{name}: {value}")
