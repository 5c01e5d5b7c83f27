"""The verbs of `rpojax detector`, and `rpojax detect`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional, arg

from rpojax.console import counting
from rpojax.errors import OutputError, RpojaxError

if TYPE_CHECKING:
    from rpojax.training.detection_data import Dataset

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
    validation: Annotated[int, arg(metavar="N", help="Pictures of other spacecraft to judge by.")] = 500,
    craft: Annotated[int, arg(metavar="N", help="Spacecraft beside the packaged target.")] = 72,
    views: Annotated[int, arg(metavar="N", help="Ray-traced views of each.")] = 14,
    seed: Seed = 0,
    preview: Annotated[Path | None, arg(metavar="PNG", help="Write the first pictures with their boxes.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> int:
    """Make pictures of ray-traced spacecraft with boxes; an interrupted call goes on with the views it has."""
    if min(count, validation) < 1 or craft < 1 or views < 1:
        raise RpojaxError("--count, --validation, --craft, --views: expected at least 1 of each")
    if preview and preview.exists() and not force:
        raise OutputError(f"{preview}: exists already; --force replaces it")
    from rpojax.training import backdrops, detection_data, sprites

    parts = ((_TRAINING, count, craft, False), (_VALIDATION, validation, max(1, round(_HELD_OUT_SHARE * craft)), True))
    for name, *_ in parts:
        if (out / name / detection_data.ANNOTATIONS).exists() and not force:
            raise OutputError(f"{out / name}: holds a data set already; --force replaces it")
    work = out.with_name(out.name + ".work")
    for name, number, variety, held_out in parts:
        with counting(f"ray tracing for {name}", quiet=as_json) as watch:
            found = sprites.trace(work / "sprites", variety, views, seed, held_out, watch)
        with counting(f"composing for {name}", quiet=as_json) as watch:
            earth = backdrops.globe(held_out, seed)
            detection_data.write(out / name, number, 2 * seed + held_out, found, earth, watch)
    content: dict[str, Any] = {"data": str(out), "views": str(work)}
    for name, *_ in parts:
        content[name] = detection_data.summary(out / name)
    if preview:
        _preview(detection_data.read(out / _TRAINING, limit=96), preview)
        content["preview"] = str(preview)
    _tell(content, as_json)
    return 0


def _preview(dataset: "Dataset", path: Path) -> None:
    import cv2

    from rpojax.training.detection_data import drawn

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
