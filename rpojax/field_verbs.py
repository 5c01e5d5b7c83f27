"""The verbs of `rpojax field`."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional, arg

from rpojax.console import counting
from rpojax.errors import OutputError, RpojaxError

if TYPE_CHECKING:
    import numpy as np

    from rpojax.training.raytrace import Views
    from rpojax.training.target_mesh import TargetMesh
    from rpojax.vision.field import Field

Mesh = Annotated[str, arg(metavar="MESH", help="Mesh file (glb, obj, ply, stl), or 'target' for the packaged one.")]
Units = Annotated[str | None, arg(metavar="UNIT", help="Units of the mesh: m, cm, mm, in, ft.")]
Center = Annotated[bool, arg(help="Move the middle of the mesh to the origin.")]
Seed = Annotated[int, arg(metavar="S", help="Seed of views and training.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
Given = Annotated[Positional[Path | None], arg(metavar="FIELD", help="Field; that of the packaged target by default.")]

app = tyro.extras.SubcommandApp()


@app.command
def train(
    mesh: Positional[Mesh],
    *,
    out: Annotated[Path, arg(metavar="FIELD", help="File to write, such as target.field.safetensors.")],
    units: Units = None,
    center: Center = False,
    views: Annotated[int, arg(metavar="N", help="Ray-traced views.")] = 300,
    steps: Annotated[int, arg(metavar="N", help="Training steps at most.")] = 2000,
    minutes: Annotated[float | None, arg(metavar="T", help="End training after so long.")] = None,
    seed: Seed = 0,
    kind: Annotated[str, arg(metavar="KIND", help="'grid', or 'point' for the slow reference network.")] = "grid",
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Ray-trace views of a mesh and train a field on them; a call that was interrupted goes on where it was."""
    if kind not in ("grid", "point"):
        raise RpojaxError(f"--kind: found {kind!r}, expected 'grid' or 'point'")
    if views < 16 or steps < 50:
        raise RpojaxError(f"--views, --steps: found {views}, {steps}, expected at least 16 views and 50 steps")
    if out.exists() and not force:
        raise OutputError(f"{out}: exists already; --force replaces it")
    from rpojax.training import raytrace, target_mesh, train_field
    from rpojax.vision.weights import save_field

    target = target_mesh.load(mesh, units, center)
    work = out.with_name(out.name + ".work")
    shell = raytrace.Shell(views, range_scale=(0.9, 1.15), seed=seed)
    with counting("ray tracing", quiet=as_json) as watch:
        traced = raytrace.render(target, shell, work, watch)
    recipe = train_field.Recipe(steps=steps, seed=seed, kind=kind, limit_s=None if minutes is None else 60.0 * minutes)
    with counting("training", quiet=as_json) as watch:
        field, history = train_field.train(
            target,
            traced,
            recipe,
            work / "checkpoint",
            lambda step: watch(step.done, step.total, f"{step.psnr_db:.1f} dB"),
        )
    # A card names no folder of one machine.
    command = f"rpojax field train {Path(mesh).name} --out {out.name} --views {views} --steps {steps} --seed {seed}"
    card = train_field.card(target, traced, recipe, history, command)
    save_field(field, out, card)
    _sheet(work / "contact_sheet.png", traced.rgb[:32])
    _tell({"field": str(out), "bytes": out.stat().st_size, "views": str(work), **card}, as_json)
    return 0


@app.command
def evaluate(
    field: Given = None,
    *,
    mesh: Mesh = "target",
    units: Units = None,
    center: Center = False,
    views: Annotated[int, arg(metavar="N", help="Fresh ray-traced views, each with a Sun of its own.")] = 64,
    samples: Annotated[int, arg(metavar="N", help="Samples per pixel of the ray tracer.")] = 256,
    range_m: Annotated[float | None, arg(metavar="R", help="Range [m]; default: the target fills 60 % of it.")] = None,
    fov_deg: Annotated[float, arg(metavar="A", help="Field of view [deg].")] = 26.0,
    seed: Seed = 0,
    sheet: Annotated[Path | None, arg(metavar="PNG", help="Write ray traces and renderings side by side.")] = None,
    as_json: AsJson = False,
) -> int:
    """Compare a field's pictures with fresh ray traces of its mesh."""
    if views < 1 or samples < 1:
        raise RpojaxError(f"--views, --samples: found {views}, {samples}, expected at least 1")
    import numpy as np

    from rpojax.training import judge

    target, network = _both(mesh, units, center, field)
    traced = _fresh(target, views, samples, seed, range_m, fov_deg, as_json)
    with counting("rendering", quiet=as_json) as watch:
        shown = judge.pictures(network, traced, watch)
    if sheet:
        count = min(8, views)
        error = np.abs(judge.codes(shown.rgb[:count]) - judge.codes(traced.rgb[:count]))
        _sheet(sheet, np.concatenate([traced.rgb[:count], shown.rgb[:count], error]), count)
    _tell(judge.figures(shown, traced), as_json)
    return 0


@app.command
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
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
) -> int:
    """Pictures of a field: a still, a contact sheet, or a turntable."""
    import numpy as np

    suffix = out.suffix.lower()
    if suffix not in (".png", ".mp4"):
        raise OutputError(f"{out}: found suffix {out.suffix!r}, expected .png or .mp4")
    if out.exists() and not force:
        raise OutputError(f"{out}: exists already; --force replaces it")
    if frames < 1 or not 8 <= size_px <= 2048 or not np.linalg.norm(sun) > 0.0:
        raise RpojaxError("--frames, --size-px, --sun: expected at least 1 frame, 8 to 2048 px, and a direction")
    from rpojax.vision.turntable import turntable
    from rpojax.vision.weights import load_field

    network, _ = load_field(field)
    pictures = turntable(network, frames, size_px, np.array(sun), elevation_deg)
    out.parent.mkdir(parents=True, exist_ok=True)
    if suffix == ".png":
        _sheet(out, pictures, min(frames, 8))
    else:
        _film(out, pictures)
    print(out)
    return 0


def _both(mesh: str, units: str | None, center: bool, field: Path | None) -> "tuple[TargetMesh, Field]":
    from rpojax.training import target_mesh
    from rpojax.vision.weights import load_field

    network, _ = load_field(field)
    return target_mesh.load(mesh, units, center), network


def _fresh(
    mesh: "TargetMesh", views: int, samples: int, seed: int, range_m: float | None, fov_deg: float, quiet: bool
) -> "Views":
    from rpojax.training import raytrace

    # Training draws from the seed itself; these views are others.
    shell = raytrace.Shell(views, samples=samples, seed=1_000_003 + seed, range_m=range_m, field_of_view_deg=fov_deg)
    with counting("ray tracing", quiet=quiet) as watch:
        return raytrace.render(mesh, shell, None, watch)


def _sheet(path: Path, images: "np.ndarray", columns: int = 8) -> None:
    import cv2

    from rpojax.training.raytrace import contact_sheet

    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), contact_sheet(images, columns)):
        raise OutputError(f"{path}: cannot be written, expected a writable place")


@contextlib.contextmanager
def _video(path: Path, size_px: int) -> Iterator[Any]:
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 24.0, (size_px, size_px))
    if not writer.isOpened():
        raise OutputError(f"{path}: cannot be written as a film, expected a writable place")
    try:
        yield writer
    finally:
        writer.release()


def _film(path: Path, pictures: "np.ndarray") -> None:
    from rpojax.training.raytrace import contact_sheet

    with _video(path, pictures.shape[1]) as writer:
        for picture in pictures:
            writer.write(contact_sheet(picture[None], 1))


def _tell(content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(content, indent=2, allow_nan=False))
        return
    for name, value in content.items():
        print(f"{name}: {value:.4g}" if isinstance(value, float) else f"{name}: {value}")
