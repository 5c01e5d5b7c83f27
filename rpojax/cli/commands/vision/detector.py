"""The commands of `rpojax detector`: synthetic data, training, evaluation."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional, arg

from rpojax.cli.command_parsing import add_command
from rpojax.cli.output_paths import claim, claim_folder, resumable
from rpojax.cli.standard_streams import print_json
from rpojax.errors import OutputError, RpojaxError
from rpojax.runtime.jax_environment import prepare_jax
from rpojax.runtime.progress import items

if TYPE_CHECKING:
    from collections.abc import Callable

    from rpojax.training.detector.training_options import NetworkTrainingOptions, NetworkTrainingProgress
    from rpojax.training.synthetic_data.composites import CompositeMix
    from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

Seed = Annotated[int, arg(metavar="S", help="Seed.")]
Force = Annotated[bool, arg(help="Replace what is there.")]
AsJson = Annotated[bool, arg(name="json", help="JSON on stdout and no progress.")]
Source = Annotated[
    Positional[Path], arg(metavar="DATASET", help="Folder with annotations.json in COCO's format, or with several.")
]
Sources = Annotated[
    Positional[tuple[Path, ...]],
    arg(metavar="DATASET...", help="Folders, each with annotations.json in COCO's format or with several."),
]
Weights = Annotated[Path | None, arg(metavar="FILE", help="Weights; the packaged ones by default.")]

_TRAINING, _VALIDATION = "training", "validation"
_HELD_OUT_SHARE = 0.28
_PROPOSAL_TIME = 0.4
"""Part of a time limit for the proposal network; a step of the other one takes twice as long."""
_MOST_JUDGED = 1000
"""Validation pictures after each pass; the figures in the weights file are of all."""


def data(
    *,
    out: Annotated[Path, arg(metavar="DIR", help="Folder to make, with the folders training and validation.")],
    count: Annotated[int, arg(metavar="N", help="Pictures to train on.")] = 2000,
    validation: Annotated[
        int, arg(metavar="N", help="Pictures for validation, of other spacecraft and the packaged target.")
    ] = 500,
    craft: Annotated[int, arg(metavar="N", help="Spacecraft beside the packaged target.")] = 72,
    views: Annotated[int, arg(metavar="N", help="Ray-traced views of each.")] = 14,
    generator: Annotated[
        Literal["1", "2", "1-empty", "2-empty"],
        arg(metavar="NAME", help="What pictures show: 2, 1 as for the first packaged weights, or no spacecraft."),
    ] = "2",
    seed: Seed = 0,
    preview: Annotated[Path | None, arg(metavar="PNG", help="Write the first pictures with their boxes.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> int:
    """Make pictures of ray-traced spacecraft with boxes; an interrupted call continues."""
    if min(count, validation) < 1 or craft < 1 or views < 1:
        raise RpojaxError.of_argument("count, validation, craft, views", "expected at least 1 of each")
    claim_folder(out)
    if preview:
        claim(preview, force, (".png", ".jpg"))
    from rpojax.training.synthetic_data import composites, detection_dataset

    mix = composites.GENERATORS[int(generator[0])]
    if generator.endswith("empty"):
        mix = dataclasses.replace(mix, empty=1.0)
    name = "" if generator == "1" else f", generator {generator}"
    parts = [
        _DataPart(
            folder,
            number,
            variety,
            views,
            seed,
            held_out,
            f"{number} of {variety} craft x {views} views, seed {seed}{name}",
        )
        for folder, number, variety, held_out in (
            (_TRAINING, count, craft, False),
            (_VALIDATION, validation, max(1, round(_HELD_OUT_SHARE * craft)), True),
        )
    ]
    missing = [part for part in parts if force or not detection_dataset.is_complete(out / part.name, part.provenance)]
    for part in missing:
        if not force and (out / part.name / detection_dataset.ANNOTATIONS).exists():
            raise OutputError(f"{out / part.name}: holds another data set already; --force replaces it")
    work = out.with_name(out.name + ".work")
    with resumable(work):
        for part in missing:
            _make_part(part, out, work, mix, quiet=as_json)
    content: dict[str, Any] = {"data": str(out), "views": str(work)}
    for part in parts:
        content[part.name] = detection_dataset.summary(out / part.name)
    if preview:
        _preview(detection_dataset.read_dataset(out / _TRAINING, limit=96), preview)
        content["preview"] = str(preview)
    _print_result(content, as_json)
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


def _make_part(part: _DataPart, out: Path, work: Path, mix: "CompositeMix", quiet: bool) -> None:
    """Traces the spacecraft of a data set, and composes its pictures."""
    from rpojax.training.synthetic_data import detection_dataset, spacecraft_sprites
    from rpojax.training.synthetic_data.scenery import earth_views

    with items(f"ray tracing for {part.name}", quiet=quiet) as watch:
        found = spacecraft_sprites.trace_sprites(
            work / "sprites", part.craft, part.views, part.seed, part.held_out, watch
        )
    with items(f"composing for {part.name}", quiet=quiet) as watch:
        earth = earth_views.load_earth_textures(part.held_out, part.seed)
        number = 2 * part.seed + part.held_out
        detection_dataset.write_dataset(out / part.name, part.number, number, found, earth, part.provenance, watch, mix)


def train(
    datasets: Sources,
    *,
    out: Annotated[Path, arg(metavar="FILE", help="File to write, such as detector.safetensors.")],
    epochs: Annotated[int, arg(metavar="N", help="Passes over the data for the proposal network.")] = 100,
    second_epochs: Annotated[int, arg(metavar="N", help="Passes over the data for the refinement network.")] = 30,
    minutes: Annotated[
        float | None, arg(metavar="T", help="Time limit of the training [min]; the schedule adapts.")
    ] = None,
    start: Annotated[
        Path | None, arg(metavar="FILE", help="Initial weights where layers agree, instead of random ones.")
    ] = None,
    rate: Annotated[float, arg(metavar="R", help="Peak learning rate.")] = 5e-3,
    seed: Seed = 0,
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
) -> int:
    """Train the detector on pictures with boxes; an interrupted call continues."""
    _check_training(epochs, second_epochs, minutes, rate)
    claim(out, force)
    prepare_jax(cache=True)
    import numpy as np

    from rpojax.scenario.plugins.command_lines import command_line
    from rpojax.training.detector import evaluate_detector, train_detector
    from rpojax.training.detector.evaluate_detector import calibrate_score
    from rpojax.training.detector.train_detector import initial_weights
    from rpojax.training.labelled_pictures.box_plausibility import pictures_in_both
    from rpojax.training.labelled_pictures.dataset_faults import noticed
    from rpojax.training.synthetic_data.detection_dataset import concatenate
    from rpojax.vision.detector.detector_file import round_to_half_precision, save_detector

    begun, before = initial_weights(start, seed)
    parts = [_training_and_validation(folder) for folder in datasets]
    known, unseen = (concatenate([part[index] for part in parts]) for index in (0, 1))
    shared = noticed("data sets", pictures_in_both(known.images, unseen.images))
    judged = unseen.subset(np.unique(np.linspace(0, len(unseen) - 1, _MOST_JUDGED).astype(int)))
    recipes = _recipes(epochs, second_epochs, seed, minutes, rate, pieces=start is None)
    checkpoint = out.with_name(out.name + ".checkpoint")
    with resumable(checkpoint), items("training", quiet=as_json, announce=True) as watch:
        tell = _told(watch, epochs / (epochs + second_epochs))
        params, history = train_detector.train(
            known, judged, recipes["proposal"], recipes["refinement"], checkpoint, tell, begun
        )
    params = round_to_half_precision(calibrate_score(params, unseen))
    found = evaluate_detector.detect_images(params, unseen.images)
    figures = evaluate_detector.detection_metrics(found, unseen)
    words = (*(folder.name for folder in datasets), "--out", out.name)
    words += ("--epochs", epochs, "--second-epochs", second_epochs, "--rate", f"{rate:g}", "--seed", seed)
    words += () if minutes is None else ("--minutes", f"{minutes:g}")
    words += ("--start", start.name) if start else ()
    # The record in the weights file holds no path of this machine.
    command = command_line("detector train", *words, plugin=None)
    card = train_detector.model_card(known, recipes, history, figures, command)
    card["start"] = before.get("command")
    save_detector(params, out, card)
    train_detector.remove_checkpoints(checkpoint)
    notes = (*known.notes, *unseen.notes, *shared, *evaluate_detector.noticed_labels(found, unseen))
    warned = list(dict.fromkeys(notes))
    _print_result({"weights": str(out), "bytes": out.stat().st_size, **card, "warnings": warned}, as_json)
    return 0


def _told(watch: "Callable[[int, int, str], None]", share: float) -> "Callable[[str, NetworkTrainingProgress], None]":
    """Tells `watch` the progress of both networks in thousandths, of which the proposal network has `share`."""

    def tell(network: str, step: "NetworkTrainingProgress") -> None:
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
) -> "dict[str, NetworkTrainingOptions]":
    """Training options of both networks; crops are for untrained weights."""
    from rpojax.training.detector.training_options import NetworkTrainingOptions

    limits = [None if minutes is None else 60.0 * minutes * part for part in (_PROPOSAL_TIME, 1.0 - _PROPOSAL_TIME)]
    share = 0.5 if pieces else 0.0
    return {
        "proposal": NetworkTrainingOptions(epochs=epochs, seed=seed, rate=rate, limit_s=limits[0], pieces_share=share),
        "refinement": NetworkTrainingOptions(
            epochs=second_epochs, seed=seed, rate=rate, limit_s=limits[1], pieces_share=0.0
        ),
    }


def evaluate(
    dataset: Source,
    *,
    weights: Weights = None,
    form: Annotated[
        Literal["coco", "speed", "spark", "yolo"],
        arg(name="format", metavar="FORMAT", help="coco, speed (SPEED+ and SHIRT too), spark or yolo."),
    ] = "coco",
    labels: Annotated[
        Path | None, arg(metavar="FILE", help="Labels of speed, spark or yolo; by default those not for training.")
    ] = None,
    limit: Annotated[int | None, arg(metavar="N", help="Most pictures of speed, spark or yolo, chosen evenly.")] = None,
    as_json: AsJson = False,
) -> int:
    """Evaluate a detector on pictures with boxes: average precision, accuracy of boxes, false alarms."""
    if limit is not None and limit < 1:
        raise RpojaxError.of_argument("limit", f"found {limit}, expected at least 1")
    if form == "coco" and not (labels is None and limit is None):
        raise RpojaxError.of_argument("format", "found 'coco', expected another one with --labels or --limit")
    from rpojax.training.detector import evaluate_detector
    from rpojax.training.public_data import data_formats
    from rpojax.vision.detector.detector_file import load_detector

    params, _ = load_detector(weights)
    if form == "coco":
        _, unseen = _training_and_validation(dataset, evaluate=True)
    else:
        unseen = data_formats.read_folder(dataset, form, labels, limit)
    _print_result(
        evaluate_detector.evaluation_report(evaluate_detector.detect_images(params, unseen.images), unseen), as_json
    )
    return 0


def _training_and_validation(folder: Path, evaluate: bool = False) -> "tuple[DetectionDataset, DetectionDataset]":
    """Training and validation data: two folders if there are two, else every tenth picture is held out."""
    import numpy as np

    from rpojax.training.labelled_pictures.dataset_faults import DatasetError
    from rpojax.training.synthetic_data import detection_dataset

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


def _preview(dataset: "DetectionDataset", path: Path) -> None:
    import cv2

    from rpojax.training.synthetic_data.detection_dataset import draw_boxes

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


COMMANDS = (data, train, evaluate)
"""Commands of `detector`."""
app = tyro.extras.SubcommandApp()
for command in COMMANDS:
    add_command(app, command)
