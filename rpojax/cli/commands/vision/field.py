"""The commands of `rpojax field`: train, evaluate and render a radiance field."""

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional, arg

from rpojax.cli.arguments import FLAT
from rpojax.cli.command_parsing import add_command
from rpojax.cli.console import show_lines
from rpojax.cli.output_paths import claim, resumable
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import items

if TYPE_CHECKING:
    import numpy as np

    from rpojax.training.radiance_field.evaluate_field import RenderedViews
    from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
    from rpojax.training.synthetic_data.ray_traced_views import Views
    from rpojax.vision.radiance_field.target_field import RadianceField

Mesh = Annotated[str, arg(metavar="MESH", help="Mesh file (glb, obj, ply, stl), or 'target' for the packaged one.")]
Seed = Annotated[int, arg(metavar="S", help="Seed of views and training.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
Given = Annotated[Positional[Path | None], arg(metavar="FIELD", help="Field; that of the packaged target by default.")]


@dataclass(frozen=True)
class MeshPlacement:
    """Scale and place of a mesh."""

    units: Annotated[str | None, arg(metavar="UNIT", help="Units of the mesh: m, cm, mm, in, ft.")] = None
    center: Annotated[bool, arg(help="Move the middle of the mesh to the origin.")] = False


@dataclass(frozen=True)
class FreshViews:
    """Views that a field is compared in, ray-traced for that.

    Raises:
        RpojaxError: a number is out of range.
    """

    views: Annotated[int, arg(metavar="N", help="Fresh ray-traced views, each with a Sun of its own.")] = 64
    samples: Annotated[int, arg(metavar="N", help="Samples per pixel of the ray tracer.")] = 256
    range_m: Annotated[float | None, arg(metavar="R", help="Range [m]; default: the target fills 60 % of it.")] = None
    fov_deg: Annotated[float, arg(metavar="A", help="Field of view [deg].")] = 26.0
    seed: Seed = 0

    def __post_init__(self) -> None:
        if self.views < 1 or self.samples < 1:
            raise RpojaxError.of_argument("views, samples", f"found {self.views}, {self.samples}, expected at least 1")
        _check_seed(self.seed)
        if not 0.0 < self.fov_deg < 170.0:
            raise RpojaxError.of_argument("fov_deg", f"found {self.fov_deg}, expected more than 0 and less than 170")


_LEAST_ALPHA = 0.02
_SHEET_LIMIT, _FILM_LIMIT = 64, 1000


def train(
    mesh: Positional[Mesh],
    placement: Annotated[MeshPlacement, FLAT],
    *,
    out: Annotated[Path, arg(metavar="FIELD", help="File to write, such as target.field.safetensors.")],
    views: Annotated[int, arg(metavar="N", help="Ray-traced views.")] = 300,
    steps: Annotated[int, arg(metavar="N", help="Training steps at most.")] = 2000,
    minutes: Annotated[float | None, arg(metavar="T", help="Time limit of the training [min].")] = None,
    seed: Seed = 0,
    kind: Annotated[str, arg(metavar="KIND", help="'grid', or 'point' for the slow reference network.")] = "grid",
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Ray-trace views of a mesh and train a field on them; an interrupted call continues."""
    _check_training(kind, views, steps, minutes)
    _check_seed(seed)
    claim(out, force)
    from rpojax.scenario.plugins.command_lines import command_line
    from rpojax.training.radiance_field import train_field
    from rpojax.training.synthetic_data import random_views, ray_traced_views
    from rpojax.training.synthetic_data.meshes import mesh_files, target_mesh
    from rpojax.vision.radiance_field.field_file import save_field

    target = mesh_files.load_mesh(mesh, placement.units, placement.center)
    show_lines(f"{mesh}: {note}" for note in target.notes)
    work = out.with_name(out.name + ".work")
    shell = random_views.ViewSampling(views, range_scale=(0.9, 1.15), seed=seed)
    recipe = train_field.FieldTrainingOptions(
        steps=steps, seed=seed, kind=kind, limit_s=None if minutes is None else 60.0 * minutes
    )
    preview = work / "contact_sheet.png"
    with resumable(work):
        with items("ray tracing", quiet=as_json) as watch:
            traced = ray_traced_views.ray_trace_views(target, shell, work, watch, partial(_preview, preview, as_json))
        with items("training", quiet=as_json, announce=True) as watch:
            field, history = train_field.train(
                target,
                traced,
                recipe,
                work / "checkpoint",
                lambda step: watch(step.done, step.total, f"{step.psnr_db:.1f} dB"),
            )
    # The record in the weights file holds no path of this machine.
    placed = (*(("--units", placement.units) if placement.units else ()), *(("--center",) if placement.center else ()))
    numbers = ("--kind", kind, "--views", views, "--steps", steps, "--seed", seed)
    command = command_line("field train", Path(mesh).name, "--out", out.name, *placed, *numbers, plugin=None)
    card = train_field.model_card(target, traced, recipe, history, command)
    save_field(field, out, card)
    hull = target_mesh.outline_vertices(target)
    files = {"field": str(out), "bytes": out.stat().st_size, "first_views": str(preview)}
    scenario = {"hull_m": hull.tolist(), "target_size_m": round(target_mesh.apparent_size(hull), 3)}
    _print_result({**files, **card, **scenario, **_mesh_notes(target)}, as_json)
    return 0


def evaluate(
    placement: Annotated[MeshPlacement, FLAT],
    fresh: Annotated[FreshViews, FLAT],
    field: Given = None,
    *,
    mesh: Annotated[str | None, arg(metavar="MESH", help="Mesh that FIELD was trained on.")] = None,
    sheet: Annotated[Path | None, arg(metavar="PNG", help="Write ray traces, renderings and differences.")] = None,
    force: Annotated[bool, arg(help="Replace the sheet if it is there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Compare a field's pictures with fresh ray traces of its mesh."""
    if sheet:
        claim(sheet, force, (".png",))
    from rpojax.training.radiance_field import evaluate_field

    target, network = _mesh_and_field(mesh, placement, field)
    traced = _ray_trace_fresh_views(target, network, fresh, as_json)
    with items("rendering", quiet=as_json) as watch:
        shown = evaluate_field.render_views(network, traced, watch)
    if sheet:
        _compare(sheet, shown, traced)
    _print_result({**evaluate_field.field_metrics(shown, traced), **_mesh_notes(target)}, as_json)
    return 0


def render(
    field: Given = None,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="Picture (.png) or turntable (.mp4) to write.")],
    frames: Annotated[int, arg(metavar="N", help="Views: one is a still, more a contact sheet or a turntable.")] = 1,
    size_px: Annotated[int, arg(metavar="P", help="Width and height of a view.")] = 256,
    sun: Annotated[tuple[float, float, float], arg(metavar="X Y Z", help="Direction of the Sun in target axes.")] = (
        1.0,
        0.6,
        0.8,
    ),
    elevation_deg: Annotated[float, arg(metavar="A", help="Height of the camera above the x-y plane.")] = 25.0,
    azimuth_deg: Annotated[float, arg(metavar="A", help="Direction of the first view, from x towards y.")] = 60.0,
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Pictures of a field: a still, a contact sheet, or a turntable."""
    claim(out, force, (".png", ".mp4"))
    still = out.suffix.lower() == ".png"
    most = _SHEET_LIMIT if still else _FILM_LIMIT
    if not 1 <= frames <= most or not 8 <= size_px <= 2048:
        raise RpojaxError.of_argument(
            "frames, size_px", f"found {frames}, {size_px}, expected 1 to {most} and 8 to 2048"
        )
    if not 0.0 < math.hypot(*sun) < math.inf:
        raise RpojaxError.of_argument("sun", f"found {sun}, expected a direction")
    if not -89.0 <= elevation_deg <= 89.0 or not math.isfinite(azimuth_deg):
        found = f"{elevation_deg}, {azimuth_deg}"
        raise RpojaxError.of_argument(
            "elevation_deg, azimuth_deg", f"found {found}, expected -89 to 89 and a finite angle"
        )
    import numpy as np

    from rpojax.campaign.storage.atomic_outputs import write_atomically
    from rpojax.vision.imaging import contact_sheets, video_files
    from rpojax.vision.imaging.turntable import camera_azimuths, render_turntable
    from rpojax.vision.radiance_field.field_file import load_field

    network, _ = load_field(field)
    around = camera_azimuths(frames, azimuth_deg)
    with items("rendering", quiet=as_json) as watch:
        pictures = _counted(render_turntable(network, around, size_px, np.array(sun), elevation_deg), frames, watch)
        if still:
            captions = [f"azimuth {azimuth:.0f} deg" for azimuth in around] if frames > 1 else []
            columns = min(8, math.ceil(math.sqrt(frames)))
            content = contact_sheets.contact_sheet_png(np.stack(list(pictures)), columns, captions)
        else:
            content = video_files.video_mp4(pictures, size_px)
    write_atomically(out, content)
    _print_result({"file": str(out), "frames": frames, "bytes": len(content)}, as_json)
    return 0


def _mesh_and_field(
    mesh: str | None, placement: MeshPlacement, field: Path | None
) -> "tuple[TargetMesh, RadianceField]":
    from rpojax.training.synthetic_data.meshes import mesh_files, packaged_target
    from rpojax.vision.radiance_field.field_file import load_field

    network, card = load_field(field)
    trained_on = card.get("target")
    if mesh is None and trained_on != packaged_target.PACKAGED_TARGET:
        raise RpojaxError.of_argument("mesh", f"missing, expected the mesh that {field} was trained on, {trained_on!r}")
    target = mesh_files.load_mesh(mesh or packaged_target.PACKAGED_TARGET, placement.units, placement.center)
    show_lines(f"{mesh}: {note}" for note in target.notes)
    _check_same(target, network)
    return target, network


def _mesh_notes(mesh: "TargetMesh") -> dict[str, Any]:
    """What of a mesh file is not used, if there is anything."""
    return {"mesh_notes": list(mesh.notes)} if mesh.notes else {}


def _check_same(mesh: "TargetMesh", field: "RadianceField") -> None:
    """Raises `RpojaxError` if a mesh and a field differ in place or size: another mesh, or other units."""
    import numpy as np

    from rpojax.vision.radiance_field.target_field import bounding_sphere

    low, high = mesh.bounds
    middle, radius = (np.asarray(value) for value in bounding_sphere(field))
    size = 0.5 * float(np.linalg.norm(high - low))
    if not 0.8 < radius / size < 1.3 or np.linalg.norm(middle - 0.5 * (low + high)) > 0.1 * size:
        found = f"{mesh.name} with a span of {float((high - low).max()):.3g} m"
        raise RpojaxError.of_argument(
            "mesh, units, center", f"found {found}, expected the mesh of the field in its place"
        )


def _ray_trace_fresh_views(
    mesh: "TargetMesh",
    field: "RadianceField",
    fresh: FreshViews,
    quiet: bool,
) -> "Views":
    from rpojax.training.synthetic_data import random_views, ray_traced_views
    from rpojax.vision.radiance_field.target_field import bounding_sphere

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


def _check_seed(seed: int) -> None:
    if not 0 <= seed < 2**31:
        raise RpojaxError.of_argument("seed", f"found {seed}, expected 0 to 2147483647")


def _preview(path: Path, quiet: bool, rgb: "np.ndarray", alpha: "np.ndarray") -> None:
    from rpojax.campaign.storage.atomic_outputs import write_atomically
    from rpojax.vision.imaging import contact_sheets

    write_atomically(path, contact_sheets.contact_sheet_png(contact_sheets.over_backdrop(rgb, alpha), columns=8))
    if not quiet:
        print(f"rpojax: first views: {path}", file=sys.stderr)


def _compare(path: Path, shown: "RenderedViews", traced: "Views", count: int = 8) -> None:
    """Writes a sheet of three rows: ray traces, pictures of the field, and their differences."""
    import numpy as np

    from rpojax.campaign.storage.atomic_outputs import write_atomically
    from rpojax.training.radiance_field import evaluate_field
    from rpojax.vision.imaging import contact_sheets

    error = np.abs(evaluate_field.srgb_codes(shown.rgb[:count]) - evaluate_field.srgb_codes(traced.rgb[:count]))
    rows = [contact_sheets.over_backdrop(p.rgb[:count], p.alpha[:count]) for p in (traced, shown)]
    captions = [f"{name} {i}" for name in ("ray trace", "field", "difference") for i in range(len(error))]
    write_atomically(path, contact_sheets.contact_sheet_png(np.concatenate([*rows, error]), len(error), captions))


def _counted(pictures: "Iterator[np.ndarray]", total: int, watch: Callable[..., None]) -> "Iterator[np.ndarray]":
    for done, picture in enumerate(pictures, start=1):
        watch(done, total)
        yield picture


def _print_result(content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(content)
        return
    for name, value in content.items():
        print(f"{name}: {value:.4g}" if isinstance(value, float) else f"{name}: {value}")


COMMANDS = (train, evaluate, render)
"""Commands of `field`."""
app = tyro.extras.SubcommandApp()
for command in COMMANDS:
    add_command(app, command)
