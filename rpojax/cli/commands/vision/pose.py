"""The commands of `rpojax pose`: training and evaluation of the network that finds landmarks."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import jax
import numpy as np

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.cli.console import show_lines
from rpojax.cli.options.vision import EvaluatePoseCommand, TrainPoseCommand
from rpojax.cli.output_paths import claim, claim_folder, resumable
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.progress import items, stage
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.training.pose import evaluate_landmarks, train_landmarks
from rpojax.training.pose.held_back_pictures import held_back_pictures
from rpojax.training.pose.landmark_views import trace_landmark_views
from rpojax.training.pose.random_scenes import paint_backdrops
from rpojax.training.pose.train_landmarks import LandmarkTrainingOptions, LandmarkTrainingProgress
from rpojax.training.pose.view_sampling import HELD_OUT_STREAM, TRAINING_STREAM, LandmarkViewSampling
from rpojax.training.synthetic_data.meshes import mesh_files
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.scenery.earth_views import load_earth_textures
from rpojax.vision.detector.detector_file import load_detector
from rpojax.vision.landmark_network.network import initialize
from rpojax.vision.landmark_network.network_file import load_network, save_network
from rpojax.vision.surface.landmark_file import load_landmarks
from rpojax.vision.surface.landmark_selection import TOLERANCE, SampledSurface
from rpojax.vision.surface.landmarks import LandmarkError, Landmarks

_BACKDROPS = 300
_BACKDROP_STREAM = 3


def train(asked: TrainPoseCommand) -> int:
    """Does the work of the command; returns its exit status."""
    claim(asked.out, asked.force)
    mesh, landmarks = _target(asked)
    start, before = initialize(jax.random.key(asked.seed), len(landmarks.positions)), {}
    if asked.start is not None:
        start, before = load_network(landmarks, asked.start)
    work = asked.out.with_name(asked.out.name + ".work")
    claim_folder(work)
    sampling = LandmarkViewSampling(asked.views, asked.seed, TRAINING_STREAM, asked.range_m)
    limit_s = None if asked.minutes is None else 60.0 * asked.minutes
    options = LandmarkTrainingOptions(epochs=asked.epochs, seed=asked.seed, rate=asked.rate, limit_s=limit_s)
    with resumable(work):
        with items("ray tracing", quiet=asked.as_json) as watch:
            views = trace_landmark_views(mesh, landmarks, sampling, work / "views", watch)
        with stage("painting backdrops", quiet=asked.as_json):
            rng = np.random.default_rng([asked.seed, _BACKDROP_STREAM])
            backdrops = paint_backdrops(rng, load_earth_textures(held_out=False, seed=asked.seed), _BACKDROPS)
        with items("training", quiet=asked.as_json, announce=True) as watch:

            def tell(step: LandmarkTrainingProgress) -> None:
                note = f"landmarks {step.accuracy['median_px']:.2f} px, sight {100.0 * step.accuracy['sight']:.1f} %"
                watch(step.done, step.total, note)

            checkpoint = work / "checkpoint.safetensors"
            params, history = train_landmarks.train_landmark_network(views, backdrops, options, start, checkpoint, tell)
    card = {
        "mesh": mesh.name,
        "landmarks": len(landmarks.positions),
        "views": asked.views,
        "recipe": dataclasses.asdict(options),
        "steps_done": history[-1].done,
        "training_s": round(history[-1].elapsed_s, 1),
        "accuracy_in_crops": history[-1].accuracy,
        "command": _train_command(asked),
        "start": before.get("command"),
    }
    save_network(params, landmarks, asked.out, card)
    _show({"file": str(asked.out), "bytes": asked.out.stat().st_size, "work": str(work), **card}, asked.as_json)
    return 0


def _target(asked: TrainPoseCommand | EvaluatePoseCommand) -> tuple[TargetMesh, Landmarks]:
    """Mesh and landmarks of a target.

    Raises:
        LandmarkError: a landmark is not on the mesh, or the camera may be inside of it.
    """
    landmarks, _ = load_landmarks(asked.landmarks)
    mesh = mesh_files.load_mesh(asked.mesh, asked.placement.units, asked.placement.center)
    show_lines(f"{asked.mesh}: {note}" for note in mesh.notes)
    triangles = np.concatenate([part.vertices[part.faces] for part in mesh.parts])
    surface = SampledSurface(triangles)
    distance = float(surface.distances(np.asarray(landmarks.positions)).max())
    if distance > TOLERANCE * surface.size:
        found = f"found one at {distance:.3g} m from the surface of {asked.mesh}"
        raise LandmarkError.of_argument("landmarks", f"{found}, expected the landmarks of that mesh")
    reach = float(np.linalg.norm(triangles, axis=2).max())
    if asked.range_m[0] <= reach:
        found = f"found {asked.range_m[0]:g}, within the {reach:.3g} m that {asked.mesh} reaches from its origin"
        raise LandmarkError.of_argument("range_m", f"{found}, expected a camera outside of it")
    return mesh, landmarks


def _train_command(asked: TrainPoseCommand) -> str:
    """The command with the names of its files, without paths of this machine."""
    given = (("mesh", Path(asked.mesh).name, "target"), ("landmarks", asked.landmarks and asked.landmarks.name, None))
    words = [word for name, value, default in given if value != default for word in (f"--{name}", value)]
    words += ["--units", asked.placement.units] if asked.placement.units else []
    words += ["--center"] if asked.placement.center else []
    words += [] if asked.range_m == (1.2, 20.0) else ["--range-m", *(f"{each:g}" for each in asked.range_m)]
    words += ["--views", asked.views, "--epochs", asked.epochs, "--rate", f"{asked.rate:g}", "--seed", asked.seed]
    words += [] if asked.minutes is None else ["--minutes", f"{asked.minutes:g}"]
    words += ["--start", asked.start.name] if asked.start else []
    return command_line("pose train", "--out", asked.out.name, *words, plugin=None)


def evaluate(asked: EvaluatePoseCommand) -> int:
    """Does the work of the command; returns its exit status."""
    claim_folder(asked.out)
    written = asked.out / "evaluation.json"
    claim(written, asked.force)
    mesh, landmarks = _target(asked)
    params, card = load_network(landmarks, asked.network)
    detector, _ = load_detector(asked.detector)
    sampling = LandmarkViewSampling(asked.views, asked.seed, HELD_OUT_STREAM, asked.range_m, asked.samples)
    with resumable(asked.out), items("ray tracing", quiet=asked.as_json) as watch:
        earth = load_earth_textures(held_out=True, seed=asked.seed)
        pictures = held_back_pictures(mesh, landmarks, earth, sampling, asked.out / "views", watch)
    with stage("finding landmarks", quiet=asked.as_json):
        boxes = {
            "detector": evaluate_landmarks.found_boxes(detector, pictures),
            "jittered": evaluate_landmarks.jittered_boxes(pictures, asked.seed),
        }
        tables = {
            source: evaluate_landmarks.table(evaluate_landmarks.results(params, landmarks, pictures, boxes[source]))
            for source in evaluate_landmarks.BOX_SOURCES
        }
    content: dict[str, Any] = {
        "network": card.get("command"),
        "mesh": mesh.name,
        "views": asked.views,
        "seed": asked.seed,
        "range_m": list(asked.range_m),
        "boxes": tables,
    }
    asked.out.mkdir(parents=True, exist_ok=True)
    write_atomically(written, json.dumps(content, indent=1).encode())
    if asked.as_json:
        print_json({"file": str(written), **content})
        return 0
    for source, rows in tables.items():
        print(f"boxes: {source}")
        print("\n".join(_lines(rows)))
    print(f"file: {written}")
    return 0


_COLUMNS = {
    "pictures": "views",
    "without_pose": "no pose",
    "attitude_deg_median": "att 50 % [deg]",
    "attitude_deg_p95": "att 95 %",
    "translation_percent_median": "place 50 % [%]",
    "translation_percent_p95": "place 95 %",
    "landmark_error_px_median": "landmark [px]",
    "landmark_nees_over_2_median": "NEES/2",
    "landmarks_used_median": "used",
    "landmarks_right_median": "right",
    "visibility_right": "sight",
}
"""Columns of the printed table, and their headings; NEES/2 is the median over that of right covariances."""


def _lines(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of a table, in columns of fixed width."""
    head = f"{'range [m]':>10} {'light':>7} " + " ".join(f"{heading:>14}" for heading in _COLUMNS.values())
    lines = [head]
    for row in rows:
        low, high = row["range_m"]
        cells = ("-" if row.get(name) is None else f"{row[name]:g}" for name in _COLUMNS)
        lines.append(f"{f'{low:g}-{high:g}':>10} {row['light']:>7} " + " ".join(f"{cell:>14}" for cell in cells))
    return lines


def _show(content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(content)
    else:
        print("\n".join(f"{name}: {value}" for name, value in content.items()))
