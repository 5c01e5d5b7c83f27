"""Formats of labelled pictures."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

from rpojax.training.labelled_pictures.box_plausibility import BoxForm
from rpojax.training.public_data import spark_folder, speed_folder, yolo_folder
from rpojax.training.public_data.labelled_picture import LabelledPicture, evenly_chosen, to_dataset
from rpojax.training.synthetic_data.composites import SIZE_PX
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

PublicFormat = Literal["speed", "spark", "yolo"]
_LISTS: Mapping[PublicFormat, Callable[[Path, Path | None], list[LabelledPicture]]] = {
    "speed": speed_folder.list_pictures,
    "spark": spark_folder.list_pictures,
    "yolo": yolo_folder.list_pictures,
}
_BOX_FORMS: Mapping[PublicFormat, BoxForm] = {
    "speed": BoxForm.POSES,
    "spark": BoxForm.CORNERS,
    "yolo": BoxForm.CENTRES,
}


def read_folder(
    folder: Path, form: PublicFormat, labels: Path | None = None, limit: int | None = None
) -> DetectionDataset:
    """Data set of a folder as it is distributed.

    Args:
        folder: of the data set, or of one of its domains
        form: its format
        labels: label file or folder, by default as in the format
        limit: most pictures, chosen evenly

    Raises:
        DatasetError: a file is missing or not as expected.
    """
    listed = _LISTS[form](folder, labels)
    return to_dataset(evenly_chosen(listed, limit), SIZE_PX, _BOX_FORMS[form], labels or folder)
