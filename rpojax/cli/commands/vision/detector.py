"""The commands of `rpojax detector`: synthetic data, training, evaluation."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpojax.cli.options.vision import EvaluateDetectorCommand, MakeDataCommand, TrainDetectorCommand
from rpojax.cli.output_paths import claim, claim_folder, resumable
from rpojax.cli.standard_streams import print_json
from rpojax.errors import OutputError, RpojaxError
from rpojax.runtime.progress import items
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.training.detector import evaluate_detector, train_detector
from rpojax.training.detector.evaluate_detector import calibrate_score
from rpojax.training.detector.train_detector import initial_weights
from rpojax.training.detector.training_options import NetworkTrainingOptions, NetworkTrainingProgress
from rpojax.training.labelled_pictures.box_plausibility import pictures_in_both
from rpojax.training.labelled_pictures.dataset_faults import DatasetError, noticed
from rpojax.training.public_data import data_formats
from rpojax.training.synthetic_data import composites, detection_dataset, spacecraft_sprites
from rpojax.training.synthetic_data.composites import CompositeMix
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset, concatenate, draw_boxes
from rpojax.training.synthetic_data.scenery import earth_views
from rpojax.vision.detector.detector_file import load_detector, round_to_half_precision, save_detector

_TRAINING, _VALIDATION = "training", "validation"
_HELD_OUT_SHARE = 0.28
_PROPOSAL_TIME = 0.4
"""Part of a time limit for the proposal network; a step of the other one takes twice as long."""
_MOST_JUDGED = 1000
"""Validation pictures after each pass; the figures in the weights file are of all."""


def data(asked: MakeDataCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if min(asked.count, asked.validation) < 1 or asked.craft < 1 or asked.views < 1:
        raise RpojaxError.of_argument("count, validation, craft, views", "expected at least 1 of each")
    claim_folder(asked.out)
    if asked.preview:
        claim(asked.preview, asked.force, (".png", ".jpg"))

    mix = composites.GENERATORS[int(asked.generator[0])]
    if asked.generator.endswith("empty"):
        mix = dataclasses.replace(mix, empty=1.0)
    name = "" if asked.generator == "1" else f", generator {asked.generator}"
    parts = [
        _DataPart(
            folder,
            number,
            variety,
            asked.views,
            asked.seed,
            held_out,
            f"{number} of {variety} craft x {asked.views} views, seed {asked.seed}{name}",
        )
        for folder, number, variety, held_out in (
            (_TRAINING, asked.count, asked.craft, False),
            (_VALIDATION, asked.validation, max(1, round(_HELD_OUT_SHARE * asked.craft)), True),
        )
    ]
    missing = [
        part
        for part in parts
        if asked.force or not detection_dataset.is_complete(asked.out / part.name, part.provenance)
    ]
    for part in missing:
        if not asked.force and (asked.out / part.name / detection_dataset.ANNOTATIONS).exists():
            raise OutputError(f"{asked.out / part.name}: holds another data set already; --force replaces it")
    work = asked.out.with_name(asked.out.name + ".work")
    with resumable(work):
        for part in missing:
            _make_part(part, asked.out, work, mix, quiet=asked.as_json)
    content: dict[str, Any] = {"data": str(asked.out), "views": str(work)}
    for part in parts:
        content[part.name] = detection_dataset.summary(asked.out / part.name)
    if asked.preview:
        _preview(detection_dataset.read_dataset(asked.out / _TRAINING, limit=96), asked.preview)
        content["preview"] = str(asked.preview)
    _print_result(content, asked.as_json)
    return 0


@dataclasses.dataclass(frozen=True)
class _DataPart:
    """Number of pictures of a data set, of how many spacecraft and views; `provenance` tells it from others."""

    name: str
    number: int
    craft: int
    views: int
    seed: int
    held_out: bool
    provenance: str


def _make_part(part: _DataPart, out: Path, work: Path, mix: CompositeMix, quiet: bool) -> None:
    """Traces the spacecraft of a data set, and composes its pictures."""
    with items(f"ray tracing for {part.name}", quiet=quiet) as watch:
        found = spacecraft_sprites.trace_sprites(
            work / "sprites", part.craft, part.views, part.seed, part.held_out, watch
        )
    with items(f"composing for {part.name}", quiet=quiet) as watch:
        earth = earth_views.load_earth_textures(part.held_out, part.seed)
        number = 2 * part.seed + part.held_out
        detection_dataset.write_dataset(out / part.name, part.number, number, found, earth, part.provenance, watch, mix)


def train(asked: TrainDetectorCommand) -> int:
    """Does the work of the command; returns its exit status."""
    _check_training(asked.epochs, asked.second_epochs, asked.minutes, asked.rate)
    claim(asked.out, asked.force)

    begun, before = initial_weights(asked.start, asked.seed)
    parts = [_training_and_validation(folder) for folder in asked.datasets]
    known, unseen = (concatenate([part[index] for part in parts]) for index in (0, 1))
    shared = noticed("data sets", pictures_in_both(known.images, unseen.images))
    judged = unseen.subset(np.unique(np.linspace(0, len(unseen) - 1, _MOST_JUDGED).astype(int)))
    recipes = _recipes(
        asked.epochs, asked.second_epochs, asked.seed, asked.minutes, asked.rate, pieces=asked.start is None
    )
    checkpoint = asked.out.with_name(asked.out.name + ".checkpoint")
    with resumable(checkpoint), items("training", quiet=asked.as_json, announce=True) as watch:
        tell = _told(watch, asked.epochs / (asked.epochs + asked.second_epochs))
        params, history = train_detector.train(
            known, judged, recipes["proposal"], recipes["refinement"], checkpoint, tell, begun
        )
    params = round_to_half_precision(calibrate_score(params, unseen))
    found = evaluate_detector.detect_images(params, unseen.images)
    figures = evaluate_detector.detection_metrics(found, unseen)
    words = (*(folder.name for folder in asked.datasets), "--out", asked.out.name)
    words += (
        "--epochs",
        asked.epochs,
        "--second-epochs",
        asked.second_epochs,
        "--rate",
        f"{asked.rate:g}",
        "--seed",
        asked.seed,
    )
    words += () if asked.minutes is None else ("--minutes", f"{asked.minutes:g}")
    words += ("--start", asked.start.name) if asked.start else ()
    # The record in the weights file holds no path of this machine.
    command = command_line("detector train", *words, plugin=None)
    card = train_detector.model_card(known, recipes, history, figures, command)
    card["start"] = before.get("command")
    save_detector(params, asked.out, card)
    train_detector.remove_checkpoints(checkpoint)
    notes = (*known.notes, *unseen.notes, *shared, *evaluate_detector.noticed_labels(found, unseen))
    warned = list(dict.fromkeys(notes))
    _print_result(
        {"weights": str(asked.out), "bytes": asked.out.stat().st_size, **card, "warnings": warned}, asked.as_json
    )
    return 0


def _told(watch: Callable[[int, int, str], None], share: float) -> Callable[[str, NetworkTrainingProgress], None]:
    """Tells `watch` the progress of both networks in thousandths, of which the proposal network has `share`."""

    def tell(network: str, step: NetworkTrainingProgress) -> None:
        begin, span = (0.0, share) if network == "proposal" else (share, 1.0 - share)
        note = f"{network} network, mAP50 {step.map50:.3f}, mAP50-95 {step.map50_95:.3f}"
        watch(round(1000 * (begin + span * step.done / step.total)), 1000, note)

    return tell


def _check_training(epochs: int, second_epochs: int, minutes: float | None, rate: float) -> None:
    """Raises `RpojaxError` on options outside of their ranges."""
    if min(epochs, second_epochs) < 1 or (minutes is not None and not minutes > 0.0):
        found = f"{epochs}, {second_epochs}, {minutes}"
        raise RpojaxError.of_argument(
            "epochs, second_epochs, minutes", f"found {found}, expected 1 or more, and a time above 0"
        )
    if not 0.0 < rate < 1.0:
        raise RpojaxError.of_argument("rate", f"found {rate}, expected a number between 0 and 1")


def _recipes(
    epochs: int, second_epochs: int, seed: int, minutes: float | None, rate: float, pieces: bool
) -> dict[str, NetworkTrainingOptions]:
    """Training options of both networks; crops are for untrained weights."""
    limits = [None if minutes is None else 60.0 * minutes * part for part in (_PROPOSAL_TIME, 1.0 - _PROPOSAL_TIME)]
    share = 0.5 if pieces else 0.0
    return {
        "proposal": NetworkTrainingOptions(epochs=epochs, seed=seed, rate=rate, limit_s=limits[0], pieces_share=share),
        "refinement": NetworkTrainingOptions(
            epochs=second_epochs, seed=seed, rate=rate, limit_s=limits[1], pieces_share=0.0
        ),
    }


def evaluate(asked: EvaluateDetectorCommand) -> int:
    """Does the work of the command; returns its exit status."""
    if asked.limit is not None and asked.limit < 1:
        raise RpojaxError.of_argument("limit", f"found {asked.limit}, expected at least 1")
    if asked.form == "coco" and not (asked.labels is None and asked.limit is None):
        raise RpojaxError.of_argument("format", "found 'coco', expected another one with --labels or --limit")

    params, _ = load_detector(asked.weights)
    if asked.form == "coco":
        _check_annotations(asked.dataset)
        _, unseen = _training_and_validation(asked.dataset, evaluate=True)
    else:
        unseen = data_formats.read_folder(asked.dataset, asked.form, asked.labels, asked.limit)
    _print_result(
        evaluate_detector.evaluation_report(evaluate_detector.detect_images(params, unseen.images), unseen),
        asked.as_json,
    )
    return 0


def _check_annotations(folder: Path) -> None:
    """Refuses a folder without annotations, naming the formats of others."""
    name = detection_dataset.ANNOTATIONS
    if not (folder / _VALIDATION).is_dir() and not (folder / name).is_file():
        expected = f"{name} in COCO's format, or --format speed, spark or yolo for a folder of these"
        raise DatasetError(f"{folder}: found no {name}, expected {expected}")


def _training_and_validation(folder: Path, evaluate: bool = False) -> tuple[DetectionDataset, DetectionDataset]:
    """Training and validation data: two folders if there are two, else every tenth picture is held out."""
    if (folder / _VALIDATION).is_dir():
        unseen = detection_dataset.read_dataset(folder / _VALIDATION)
        return (unseen if evaluate else detection_dataset.read_dataset(folder / _TRAINING)), unseen
    whole = detection_dataset.read_dataset(folder)
    if evaluate:
        return whole, whole
    number = np.arange(len(whole))
    if len(whole) < 20:
        raise DatasetError(f"{folder}: found {len(whole)} images, expected at least 20 to train on")
    return whole.subset(number[number % 10 != 0]), whole.subset(number[number % 10 == 0])


def _preview(dataset: DetectionDataset, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), draw_boxes(dataset.images, dataset.boxes)):
        raise OutputError(f"{path}: cannot be written, expected a writable place")


def _print_result(content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(content)
        return
    for name, value in content.items():
        if isinstance(value, dict):
            print(f"{name}:")
            for key, entry in value.items():
                print(f"  {key}: {entry}")
        else:
            print(f"{name}: {value}")
