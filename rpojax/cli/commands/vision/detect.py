"""The command `rpojax detect`: boxes of spacecraft in pictures."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpojax.cli.options.vision import DetectCommand
from rpojax.cli.standard_streams import print_json, print_problem
from rpojax.errors import OutputError, RpojaxError
from rpojax.runtime.progress import stage
from rpojax.vision.detector.detector_file import load_detector
from rpojax.vision.detector.multiscale_detection import detect_multiscale
from rpojax.vision.detector.scored_box import ScoredBox
from rpojax.vision.imaging import image_files


def detect(asked: DetectCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if not asked.images or not 0.0 < asked.threshold < 1.0:
        raise RpojaxError(
            f"IMAGE, --threshold: found {len(asked.images)}, {asked.threshold}, expected a picture and 0 to 1"
        )
    targets = [None] * len(asked.images) if asked.drawn is None else _targets(asked.drawn, asked.images)
    given = {path.resolve() for path in asked.images}
    if taken := next((path for path in targets if path and path.resolve() in given), None):
        raise OutputError(f"{taken}: is one of the pictures to search, expected --drawn in another folder")
    if not asked.force and (there := next((path for path in targets if path and path.exists()), None)):
        raise OutputError(f"{there}: exists already; --force replaces it")

    params, _ = load_detector(asked.weights)
    results = []
    for path, target in zip(asked.images, targets, strict=True):
        try:
            image = image_files.read_image(path)
        except image_files.ImageFileError as error:
            print_problem("error", str(error), as_json=False)
            continue
        with stage(f"searching {path.name}", quiet=asked.as_json, announce=False):
            found = detect_multiscale(params, image, asked.threshold)
        results.append({"file": str(path), "boxes": [_entry(box) for box in found]})
        if target:
            _draw(image, found, target)
        if not asked.as_json:
            _print_boxes(results[-1])
    if asked.as_json:
        print_json(results)
    return 0 if len(results) == len(asked.images) else 3 if results else 2


def _targets(drawn: Path, images: tuple[Path, ...]) -> list[Path]:
    """Paths of the pictures with boxes; repeated names are numbered."""
    taken: list[Path] = []
    for path in images:
        target, number = drawn / f"{path.stem}.png", 2
        while target in taken:
            target, number = drawn / f"{path.stem}-{number}.png", number + 1
        taken.append(target)
    return taken


def _entry(box: ScoredBox) -> dict[str, float]:
    sides = {"x": box.left, "y": box.top, "w": box.right - box.left, "h": box.bottom - box.top}
    return {**{name: round(value, 2) for name, value in sides.items()}, "score": round(box.score, 4)}


def _print_boxes(result: dict[str, Any]) -> None:
    print(f"{result['file']}: {len(result['boxes'])} found")
    for box in result["boxes"]:
        print(f"  x {box['x']:.1f}, y {box['y']:.1f}, w {box['w']:.1f}, h {box['h']:.1f}, score {box['score']:.2f}")


def _draw(image: np.ndarray, boxes: list[ScoredBox], path: Path) -> None:
    shown = np.ascontiguousarray(np.round(255.0 * image).astype(np.uint8)[..., ::-1])
    width = max(1, round(max(image.shape[:2]) / 400))
    for box in boxes:
        corners = [round(edge) for edge in (box.left, box.top, box.right, box.bottom)]
        cv2.rectangle(shown, (corners[0], corners[1]), (corners[2], corners[3]), (0, 255, 0), width)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        done = cv2.imwrite(str(path), shown)
    except OSError:
        done = False
    if not done:
        raise OutputError(f"{path}: cannot be written, expected a writable place")
