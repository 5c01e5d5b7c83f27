"""Measurements of the detector; each part prints JSON, see README.md."""

import argparse
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import jax
import jax.numpy as jnp
import numpy as np

from rpojax.benchmark.timed_device_programs import compile_for_devices
from rpojax.training.detector import evaluate_detector
from rpojax.training.detector.average_precision import long_side, pair_kind
from rpojax.training.radiance_field import evaluate_field
from rpojax.training.synthetic_data import random_views, ray_traced_views
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset, read_dataset
from rpojax.training.synthetic_data.image_sensor import ImageSensor, expose_image
from rpojax.training.synthetic_data.meshes import packaged_target
from rpojax.training.synthetic_data.scenery import backdrops, earth_views
from rpojax.training.synthetic_data.visible_box import visible_box
from rpojax.vision.detector import proposal_network
from rpojax.vision.detector.detector_file import load_detector
from rpojax.vision.detector.multiscale_detection import detect_multiscale
from rpojax.vision.detector.scored_box import ScoredBox, box_edges
from rpojax.vision.detector.two_stage_detector import DetectorParams, detect
from rpojax.vision.imaging import image_files, srgb
from rpojax.vision.imaging.random_sky import random_sky
from rpojax.vision.imaging.sky_background import background
from rpojax.vision.intersection_over_union import pairwise_iou
from rpojax.vision.pinhole import pinhole_intrinsics
from rpojax.vision.radiance_field.field_file import load_field

FIELD_OF_VIEW_DEG = 10.0
SIZE_PX = 128
RANGES_M = (20.0, 60.0)
SCALES = (1.0, 0.5, 0.25, 0.125)
"""Of whole photographs."""
SIDES_PX = (12, 16, 24, 32, 48, 64, 96)
_BATCH = 16


def main() -> int:
    """Prints the metrics of one part as JSON."""
    parts: dict[str, Callable[[argparse.Namespace, DetectorParams], dict[str, Any]]] = {
        "validation": _validation,
        "neighbours": _neighbours,
        "target": _target,
        "speed": _speed,
        "photographs": _photographs,
        "peer": _peer,
    }
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=parts)
    parser.add_argument("folder", type=Path, nargs="?", help="data set, or folder of photographs with boxes.json")
    parser.add_argument("--found", type=Path, help="detections written by peer.py")
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--views", type=int, default=200)
    parser.add_argument("--sheet", type=Path, help="image of the detections to write")
    arguments = parser.parse_args()
    if arguments.part in ("validation", "neighbours", "photographs", "peer") and arguments.folder is None:
        parser.error(f"{arguments.part}: expected a folder")
    params, _ = load_detector(arguments.weights)
    print(json.dumps(parts[arguments.part](arguments, params), indent=1))
    return 0


def _validation(arguments: argparse.Namespace, params: DetectorParams) -> dict[str, Any]:
    data = read_dataset(arguments.folder)
    found = evaluate_detector.detect_images(params, data.images)
    if arguments.sheet:
        cv2.imwrite(str(arguments.sheet), _contact_sheet(data, found, 48))
    return evaluate_detector.evaluation_report(found, data)


def _neighbours(arguments: argparse.Namespace, params: DetectorParams) -> dict[str, Any]:
    """How often a spacecraft is found that is alone in its image, or with another one apart, near or overlapping.

    The other one may have any size; only those of `MIN_SIDE_PX` count.
    """
    data = read_dataset(arguments.folder)
    found = evaluate_detector.detect_images(params, data.images)
    best: dict[str, list[float]] = {}
    for boxes, scores, labels in zip(found.boxes, found.scores, data.boxes, strict=True):
        real = labels.astype(np.float64)
        kind = "alone" if len(real) == 1 else pair_kind(real, 0.0) or "apart"
        hit = pairwise_iou(boxes, real) >= 0.5
        score = np.max(np.where(hit, scores[:, None], 0.0), axis=0, initial=0.0)
        best.setdefault(kind, []).extend(score[long_side(real) >= evaluate_detector.MIN_SIDE_PX].tolist())
    return {
        kind: {
            "spacecraft": len(values),
            "found": _mean([value >= evaluate_detector.SCORE_THRESHOLD for value in values]),
            "found_with_any_score": _mean([value > 0.0 for value in values]),
        }
        for kind, values in best.items()
    }


def _peer(arguments: argparse.Namespace, params: DetectorParams) -> dict[str, Any]:
    data = read_dataset(arguments.folder)
    with np.load(arguments.found) as content:
        about = json.loads(str(content["about"]))
        count = range(len(data))
        found = evaluate_detector.ImageDetections(
            [content[f"boxes_{i}"] for i in count], [content[f"scores_{i}"] for i in count]
        )
    return {**about, **evaluate_detector.evaluation_report(found, data)}


# The packaged target in the camera of the packaged scenarios.


def _target(arguments: argparse.Namespace, params: DetectorParams) -> dict[str, Any]:
    view_sampling = random_views.ViewSampling(
        arguments.views,
        size_px=SIZE_PX,
        samples=64,
        range_m=1.0,
        range_scale=RANGES_M,
        field_of_view_deg=FIELD_OF_VIEW_DEG,
        seed=77,
    )
    views = ray_traced_views.ray_trace_views(packaged_target.packaged_target(), view_sampling)
    rendered = evaluate_field.render_views(load_field()[0], views)
    results: dict[str, Any] = {}
    sheet = []
    sources = {
        "ray traces": (views.radiance(evaluate_field.FILL_LIGHT), views.alpha),
        "radiance field": (rendered.rgb, rendered.alpha),
    }
    for name, (color, alpha) in sources.items():
        for background_name in ("black", "sky"):
            for label in ("visible", "silhouette"):
                data = _dataset_before(color, alpha, views.alpha, background_name, label == "visible")
                found = evaluate_detector.detect_images(params, data.images)
                results[f"{name}, {background_name}, {label}"] = evaluate_detector.detection_metrics(found, data)
                if label == "visible":
                    sheet.append(_contact_sheet(data, found, 24))
    if arguments.sheet:
        cv2.imwrite(str(arguments.sheet), np.concatenate(sheet))
    return results


def _dataset_before(
    color: np.ndarray, alpha: np.ndarray, truth: np.ndarray, background_name: str, visible: bool
) -> DetectionDataset:
    """Images of views shifted in the frame, with the boxes of the ray-traced silhouettes."""
    images, boxes = [], []
    sky, intrinsics = random_sky(), pinhole_intrinsics(jnp.asarray(np.radians(FIELD_OF_VIEW_DEG)), SIZE_PX, SIZE_PX)
    for index in range(len(color)):
        rng = np.random.default_rng([5, index])
        shift = tuple(int(n) for n in rng.integers(-40, 41, 2))
        linear, cover, real = (np.roll(v[index], shift, axis=(0, 1)) for v in (color, alpha, truth))
        back = np.zeros_like(linear) if background_name == "black" else _random_sky_background(rng, sky, intrinsics)
        image = linear + back * (1.0 - cover[..., None])
        box = visible_box(image, back, real) if visible else evaluate_field.silhouette_box(real)
        images.append(expose_image(rng, image, ImageSensor(2e4, 10.0)))
        boxes.append(np.zeros((0, 4)) if box is None else np.array(box).reshape(1, 4))
    return DetectionDataset(np.stack(images), tuple(boxes), (background_name,) * len(images))


def _random_sky_background(rng: np.random.Generator, sky: Any, intrinsics: Any) -> np.ndarray:
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    position, sun = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turned, place, light = (jnp.asarray(v, jnp.float32) for v in (axes * np.linalg.det(axes), 1.078 * position, sun))
    turn = jnp.zeros((), jnp.float32)
    return np.asarray(background(sky, intrinsics, SIZE_PX, SIZE_PX, turned, place, light, turn))


def _contact_sheet(data: DetectionDataset, found: evaluate_detector.ImageDetections, count: int) -> np.ndarray:
    from rpojax.training.synthetic_data.detection_dataset import draw_boxes

    boxes = [
        b[s >= evaluate_detector.SCORE_THRESHOLD]
        for b, s in zip(found.boxes[:count], found.scores[:count], strict=True)
    ]
    return np.asarray(
        cv2.resize(draw_boxes(data.images[:count], boxes), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    )


# Speed.


def _speed(arguments: argparse.Namespace, params: DetectorParams) -> dict[str, Any]:
    """Milliseconds per image in a batch, as one program, and as one program per device as in campaigns."""
    results: dict[str, Any] = {"devices": jax.device_count()}
    images = jnp.asarray(np.random.default_rng(0).random((_BATCH, SIZE_PX, SIZE_PX, 3)), jnp.float32)
    functions: dict[str, Callable[..., Any]] = {
        "proposals alone": lambda params, images: proposal_network.detect(params["proposal"], images, 1)
    }
    functions |= {f"refinement of {count}": partial(detect, count=count) for count in (1, 2, 4)}
    for name, function in functions.items():
        program = jax.jit(function)
        begin = time.perf_counter()
        jax.block_until_ready(program(params, images))
        compiled = time.perf_counter() - begin
        shares = [(params, share) for share in jnp.split(images, jax.device_count())]
        several = compile_for_devices(function, shares, jax.devices())
        results[name] = {
            "one_program_ms": _time_of(lambda p=program: p(params, images)),
            "a_program_a_device_ms": _time_of(several.run),
            "compile_s": round(compiled, 2),
        }
    return results


def _time_of(call: Callable[[], Any]) -> dict[str, float]:
    """Best and median of 60 calls, per image."""
    times = []
    jax.block_until_ready(call())
    for _ in range(60):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        times.append((time.perf_counter() - begin) / _BATCH * 1e3)
    return {"best": round(min(times), 3), "median": round(float(np.median(times)), 3)}


# Photographs.


def _photographs(arguments: argparse.Namespace, params: DetectorParams) -> dict[str, Any]:
    """Photographs at several scales, shrunk in front of backgrounds, and empty backgrounds."""
    known = json.loads((arguments.folder / "boxes.json").read_text())["images"]
    earth = earth_views.load_earth_textures(held_out=True)
    rows, shrunk = [], []
    for name, entry in known.items():
        image = image_files.read_image(arguments.folder / name)
        real = [ScoredBox(*(float(edge) for edge in box[:4]), score=1.0) for box in entry["boxes"]]
        rows += [{"file": name, **_at_scale(params, image, real, scale)} for scale in SCALES]
        for side in SIDES_PX:
            for kind in ("own", "black", "stars", "earth", "limb") if _on_black(image) else ("own",):
                shrunk += [(side, kind, *_detect_shrunk(params, image, box, side, kind, earth)) for box in real]
    empty = {kind: _boxes_per_empty_frame(params, kind, earth) for kind in ("earth", "limb", "night", "glint", "stars")}
    return {
        "whole": rows,
        "recall_shrunk": _mean([hit for *_, hit, _ in shrunk]),
        "false_boxes_shrunk": _mean([wrong for *_, wrong in shrunk]),
        "by_side": {str(side): _mean([hit for s, _, hit, _ in shrunk if s == side]) for side in SIDES_PX},
        "by_background": {
            kind: _mean([hit for _, k, hit, _ in shrunk if k == kind])
            for kind in ("own", "black", "stars", "earth", "limb")
        },
        "boxes_per_empty_frame": empty,
    }


def _at_scale(params: DetectorParams, image: np.ndarray, real: list[ScoredBox], scale: float) -> dict[str, Any]:
    """Boxes found in a photograph shrunk by a scale, of how many, and false ones."""
    sides = [max(1, round(n * scale)) for n in image.shape[1::-1]]
    small = np.asarray(cv2.resize(image, sides, interpolation=cv2.INTER_AREA)) if scale < 1.0 else image
    known = [ScoredBox(*(scale * float(edge) for edge in (b.left, b.top, b.right, b.bottom)), score=1.0) for b in real]
    found = detect_multiscale(params, small)
    return {
        "scale": scale,
        "found": _hits(known, found),
        "of": len(real),
        "false": _false_boxes(known, found),
        "long_side_px": [round(max(b.right - b.left, b.bottom - b.top)) for b in known],
    }


def _on_black(image: np.ndarray) -> bool:
    """Whether a photograph has black all round, so that its spacecraft can be cut out."""
    rim = np.concatenate([image[:4].reshape(-1, 3), image[-4:].reshape(-1, 3), image[:, [0, -1]].reshape(-1, 3)])
    return float(np.quantile(rim, 0.99)) < 0.08


def _hits(real: list[ScoredBox], found: list[ScoredBox]) -> int:
    return int(_overlaps(real, found).any(axis=1).sum())


def _false_boxes(real: list[ScoredBox], found: list[ScoredBox]) -> int:
    return int((~_overlaps(real, found).any(axis=0)).sum())


def _overlaps(real: list[ScoredBox], found: list[ScoredBox]) -> np.ndarray:
    """Whether each real box (n,) overlaps each found one (m,) at least half."""
    return pairwise_iou(box_edges(real), box_edges(found)) >= 0.5


def _mean(values: list[Any]) -> float:
    return round(float(np.mean(values)), 3)


def _detect_shrunk(
    params: DetectorParams, image: np.ndarray, box: ScoredBox, side: int, kind: str, earth: earth_views.EarthTextures
) -> tuple[bool, int]:
    """Whether the spacecraft of a photograph is found at a size in a 128 px frame, and the number of false boxes.

    With its own background the photograph is shrunk, cropped and padded by its edges; over another one a photograph on
    black is blended by its brightness.
    """
    scale = side / max(box.right - box.left, box.bottom - box.top)
    rng = np.random.default_rng([side, len(kind)])
    corner = [rng.uniform(2.0, SIZE_PX - 2.0 - scale * n) for n in (box.right - box.left, box.bottom - box.top)]
    # Area averaging first, then the exact shift, as for composites.
    sides = [max(1, round(n * scale)) for n in image.shape[1::-1]]
    small = np.asarray(cv2.resize(image, sides, interpolation=cv2.INTER_AREA))
    ratio = [n / m for n, m in zip(sides, image.shape[1::-1], strict=True)]
    shift = [corner[0] - ratio[0] * box.left, corner[1] - ratio[1] * box.top]
    matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    mode = cv2.BORDER_REPLICATE if kind == "own" else cv2.BORDER_CONSTANT
    placed = np.asarray(cv2.warpAffine(small, matrix, (SIZE_PX, SIZE_PX), flags=cv2.INTER_LINEAR, borderMode=mode))
    if kind != "own":
        placed = _before_backdrop(rng, placed, corner, side, box, scale, kind, earth)
    real = ScoredBox(
        corner[0],
        corner[1],
        corner[0] + ratio[0] * (box.right - box.left),
        corner[1] + ratio[1] * (box.bottom - box.top),
        1.0,
    )
    found = detect_multiscale(params, placed.astype(np.float32))
    return bool(_hits([real], found)), _false_boxes([real], found)


def _before_backdrop(
    rng: np.random.Generator,
    placed: np.ndarray,
    corner: list[float],
    side: int,
    box: ScoredBox,
    scale: float,
    kind: str,
    earth: earth_views.EarthTextures,
) -> np.ndarray:
    """The box of a photograph over a backdrop, with an alpha from its brightness."""
    y, x = np.mgrid[:SIZE_PX, :SIZE_PX] + 0.5
    inside = (x > corner[0] - 1.0) & (x < corner[0] + scale * (box.right - box.left) + 1.0)
    inside &= (y > corner[1] - 1.0) & (y < corner[1] + scale * (box.bottom - box.top) + 1.0)
    matte = np.clip(placed.max(axis=2) / 0.12, 0.0, 1.0) * inside
    back = srgb.linear_to_srgb_numpy(backdrops.paint_backdrop(rng, kind, earth, SIZE_PX))
    return placed * matte[..., None] + back * (1.0 - matte[..., None])


def _boxes_per_empty_frame(params: DetectorParams, kind: str, earth: earth_views.EarthTextures) -> float:
    counts = []
    for index in range(150):
        rng = np.random.default_rng([11, index])
        image = expose_image(rng, backdrops.paint_backdrop(rng, kind, earth, SIZE_PX), ImageSensor(2e4, 8.0))
        counts.append(len(detect_multiscale(params, image.astype(np.float32) / np.float32(255.0))))
    return _mean(counts)


if __name__ == "__main__":
    sys.exit(main())
