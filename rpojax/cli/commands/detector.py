"""The verbs of `rpojax detector`, and `rpojax detect`."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional, arg

from rpojax.cli.console import counting
from rpojax.cli.output_paths import claim, claim_folder, resumable
from rpojax.errors import OutputError, RpojaxError
from rpojax.runtime.jax_environment import prepare_jax

if TYPE_CHECKING:
    import numpy as np

    from rpojax.training.detector.training_loop import Recipe, Step
    from rpojax.training.synthetic_data.detection_dataset import Dataset
    from rpojax.vision.detector.multiscale_detection import Box

Seed = Annotated[int, arg(metavar="S", help="Seed.")]
Force = Annotated[bool, arg(help="Replace what is there.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
Source = Annotated[
    Positional[Path], arg(metavar="DATASET", help="Folder with annotations.json in COCO's format, or with several.")
]
Weights = Annotated[Path | None, arg(metavar="FILE", help="Weights; the packaged ones by default.")]

_TRAINING, _VALIDATION = "training", "validation"
_HELD_OUT_SHARE = 0.28

app = tyro.extras.SubcommandApp()


@app.command
def data(
    *,
    out: Annotated[Path, arg(metavar="DIR", help="Folder to make, with the folders training and validation.")],
    count: Annotated[int, arg(metavar="N", help="Pictures to train on.")] = 2000,
    validation: Annotated[
        int, arg(metavar="N", help="Pictures to judge by, of other spacecraft and the packaged target.")
    ] = 500,
    craft: Annotated[int, arg(metavar="N", help="Spacecraft beside the packaged target.")] = 72,
    views: Annotated[int, arg(metavar="N", help="Ray-traced views of each.")] = 14,
    seed: Seed = 0,
    preview: Annotated[Path | None, arg(metavar="PNG", help="Write the first pictures with their boxes.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> int:
    """Make pictures of ray-traced spacecraft with boxes; an interrupted call goes on where it was."""
    if min(count, validation) < 1 or craft < 1 or views < 1:
        raise RpojaxError("--count, --validation, --craft, --views: expected at least 1 of each")
    claim_folder(out)
    if preview:
        claim(preview, force, (".png", ".jpg"))
    from rpojax.training.synthetic_data import backdrops, detection_dataset, spacecraft_sprites

    parts = ((_TRAINING, count, craft, False), (_VALIDATION, validation, max(1, round(_HELD_OUT_SHARE * craft)), True))
    made = {name: f"{number} of {variety} craft x {views} views, seed {seed}" for name, number, variety, _ in parts}
    done = {name: not force and detection_dataset.is_made(out / name, made[name]) for name in made}
    for name in made:
        if not (force or done[name]) and (out / name / detection_dataset.ANNOTATIONS).exists():
            raise OutputError(f"{out / name}: holds another data set already; --force replaces it")
    work = out.with_name(out.name + ".work")
    with resumable(work):
        for name, number, variety, held_out in parts:
            if done[name]:
                continue
            with counting(f"ray tracing for {name}", quiet=as_json) as watch:
                found = spacecraft_sprites.trace(work / "sprites", variety, views, seed, held_out, watch)
            with counting(f"composing for {name}", quiet=as_json) as watch:
                earth = backdrops.globe(held_out, seed)
                detection_dataset.write(out / name, number, 2 * seed + held_out, found, earth, made[name], watch)
    content: dict[str, Any] = {"data": str(out), "views": str(work)}
    for name, *_ in parts:
        content[name] = detection_dataset.summary(out / name)
    if preview:
        _preview(detection_dataset.read(out / _TRAINING, limit=96), preview)
        content["preview"] = str(preview)
    _tell(content, as_json)
    return 0


@app.command
def train(
    dataset: Source,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as detector.safetensors.")],
    epochs: Annotated[int, arg(metavar="N", help="Passes over the data for the first look.")] = 100,
    second_epochs: Annotated[int, arg(metavar="N", help="Passes for the second look.")] = 30,
    minutes: Annotated[float | None, arg(metavar="T", help="End training after so long; the schedule adapts.")] = None,
    start: Annotated[Path | None, arg(metavar="FILE", help="Weights to begin with, instead of untrained ones.")] = None,
    rate: Annotated[float, arg(metavar="R", help="Largest rate of learning.")] = 5e-3,
    seed: Seed = 0,
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Train the detector on pictures with boxes; a call that was interrupted goes on where it was."""
    if min(epochs, second_epochs) < 1 or (minutes is not None and not minutes > 0.0):
        found = f"{epochs}, {second_epochs}, {minutes}"
        raise RpojaxError(
            f"--epochs, --second-epochs, --minutes: found {found}, expected 1 or more, and a time above 0"
        )
    if not 0.0 < rate < 1.0:
        raise RpojaxError(f"--rate: found {rate}, expected a number between 0 and 1")
    claim(out, force)
    prepare_jax(cache=True)
    from rpojax.training.detector import evaluate_detector, train_detector
    from rpojax.vision.detector.two_stage_detector import load_detector, rounded, save_detector

    begun, before = load_detector(start) if start else (None, {})

    known, unseen = _halves(dataset)
    recipes = _recipes(epochs, second_epochs, seed, minutes, rate, pieces=start is None)
    checkpoint = out.with_name(out.name + ".checkpoint")
    with resumable(checkpoint), counting("training", quiet=as_json) as watch:

        def tell(look: str, step: "Step") -> None:
            share = epochs / (epochs + second_epochs)
            begin, span = (0.0, share) if look == "first" else (share, 1.0 - share)
            note = f"{look} look, mAP50 {step.map50:.3f}, mAP50-95 {step.map50_95:.3f}"
            watch(round(1000 * (begin + span * step.done / step.total)), 1000, note)

        params, history = train_detector.train(
            known, unseen, recipes["first"], recipes["second"], checkpoint, tell, begun
        )
    params = rounded(params)
    figures = evaluate_detector.figures(evaluate_detector.find(params, unseen.images), unseen)
    limit = ("" if minutes is None else f" --minutes {minutes:g}") + (f" --start {start.name}" if start else "")
    passes = f"--epochs {epochs} --second-epochs {second_epochs}"
    # A card names no folder of one machine.
    command = f"rpojax detector train {dataset.name} --out {out.name} {passes} --rate {rate:g} --seed {seed}{limit}"
    card = train_detector.card(known, recipes, history, figures, command)
    card["start"] = before.get("command")
    save_detector(params, out, card)
    train_detector.forget(checkpoint)
    _tell({"weights": str(out), "bytes": out.stat().st_size, **card}, as_json)
    return 0


def _recipes(
    epochs: int, second_epochs: int, seed: int, minutes: float | None, rate: float, pieces: bool
) -> "dict[str, Recipe]":
    """How each look is trained; of a limited time the second one gets a third. Only what is untrained sees pieces."""
    from rpojax.training.detector.training_loop import Recipe

    limits = (None, None) if minutes is None else (40.0 * minutes, 20.0 * minutes)
    share = 0.5 if pieces else 0.0
    return {
        "first": Recipe(epochs=epochs, seed=seed, rate=rate, limit_s=limits[0], pieces_share=share),
        "second": Recipe(epochs=second_epochs, seed=seed, rate=rate, limit_s=limits[1], pieces_share=0.0),
    }


@app.command
def evaluate(dataset: Source, *, weights: Weights = None, as_json: AsJson = False) -> int:
    """Judge a detector on pictures with boxes: average precision, boxes' accuracy, false alarms."""
    from rpojax.training.detector import evaluate_detector
    from rpojax.vision.detector.two_stage_detector import load_detector

    params, _ = load_detector(weights)
    _, unseen = _halves(dataset, evaluate=True)
    _tell(evaluate_detector.report(evaluate_detector.find(params, unseen.images), unseen), as_json)
    return 0


def detect(
    images: Annotated[Positional[tuple[Path, ...]], arg(metavar="IMAGE", help="JPEG or PNG pictures.")],
    *,
    weights: Weights = None,
    threshold: Annotated[float, arg(metavar="P", help="Least score of a box.")] = 0.65,
    drawn: Annotated[Path | None, arg(metavar="DIR", help="Write the pictures with their boxes here, as PNG.")] = None,
    force: Annotated[bool, arg(help="Replace pictures that are there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Find spacecraft in pictures of any size; boxes are in pixels of the upright picture, x and y at the upper left.

    A picture that cannot be used is named on stderr and the rest are searched; the exit status is then 3, or 2 if none
    could be used.
    """
    if not images or not 0.0 < threshold < 1.0:
        raise RpojaxError(f"IMAGE, --threshold: found {len(images)}, {threshold}, expected a picture and 0 to 1")
    targets = [None] * len(images) if drawn is None else _targets(drawn, images)
    given = {path.resolve() for path in images}
    if taken := next((path for path in targets if path and path.resolve() in given), None):
        raise OutputError(f"{taken}: is one of the pictures to search, expected --drawn in another folder")
    if not force and (there := next((path for path in targets if path and path.exists()), None)):
        raise OutputError(f"{there}: exists already; --force replaces it")
    from rpojax.vision.detector.multiscale_detection import search
    from rpojax.vision.detector.two_stage_detector import load_detector
    from rpojax.vision.imaging import image_files

    params, _ = load_detector(weights)
    results = []
    for path, target in zip(images, targets, strict=True):
        try:
            image = image_files.read(path)
        except image_files.PictureError as error:
            print(f"rpojax: error: {' '.join(str(error).split())}", file=sys.stderr)
            continue
        found = search(params, image, threshold)
        results.append({"file": str(path), "boxes": [_entry(box) for box in found]})
        if target:
            _draw(image, found, target)
        if not as_json:
            _say(results[-1])
    if as_json:
        print(json.dumps(results, indent=2, allow_nan=False))
    return 0 if len(results) == len(images) else 3 if results else 2


def _targets(drawn: Path, images: tuple[Path, ...]) -> list[Path]:
    """Where the drawn pictures go; of like names the later ones are numbered."""
    taken: list[Path] = []
    for path in images:
        target, number = drawn / f"{path.stem}.png", 2
        while target in taken:
            target, number = drawn / f"{path.stem}-{number}.png", number + 1
        taken.append(target)
    return taken


def _entry(box: "Box") -> dict[str, float]:
    sides = {"x": box.left, "y": box.top, "w": box.right - box.left, "h": box.bottom - box.top}
    return {**{name: round(value, 2) for name, value in sides.items()}, "score": round(box.score, 4)}


def _say(result: dict[str, Any]) -> None:
    print(f"{result['file']}: {len(result['boxes'])} found")
    for box in result["boxes"]:
        print(f"  x {box['x']:.1f}, y {box['y']:.1f}, w {box['w']:.1f}, h {box['h']:.1f}, score {box['score']:.2f}")


def _draw(image: "np.ndarray", boxes: "list[Box]", path: Path) -> None:
    import cv2
    import numpy as np

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


def _halves(folder: Path, evaluate: bool = False) -> "tuple[Dataset, Dataset]":
    """What to train on and what to judge by: two folders where there are two, else every tenth picture is held out."""
    import numpy as np

    from rpojax.training.synthetic_data import detection_dataset

    if (folder / _VALIDATION).is_dir():
        unseen = detection_dataset.read(folder / _VALIDATION)
        return (unseen if evaluate else detection_dataset.read(folder / _TRAINING)), unseen
    whole = detection_dataset.read(folder)
    if evaluate:
        return whole, whole
    number = np.arange(len(whole))
    if len(whole) < 20:
        raise detection_dataset.DatasetError(f"{folder}: found {len(whole)} images, expected at least 20 to train on")
    return whole.part(number[number % 10 != 0]), whole.part(number[number % 10 == 0])


def _preview(dataset: "Dataset", path: Path) -> None:
    import cv2

    from rpojax.training.synthetic_data.detection_dataset import drawn

    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), drawn(dataset.images, dataset.boxes)):
        raise OutputError(f"{path}: cannot be written, expected a writable place")


def _tell(content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(content, indent=2, allow_nan=False))
        return
    for name, value in content.items():
        if isinstance(value, dict):
            print(f"{name}:")
            for key, entry in value.items():
                print(f"  {key}: {entry}")
        else:
            print(f"{name}: {value}")
