"""Trains a YOLO of ultralytics from scratch on the same images, with the same augmentation, for comparison.

Runs in its own environment (torch, ultralytics, numpy, opencv), not in that of the package. `measure.py peer` evaluates
the detections that it writes like those of the package's detector.
"""

import argparse
import contextlib
import importlib.machinery
import json
import sys
import time
import types
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.training.detector.augmentation import Batch, augment_batch
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset, read_dataset

BATCH = 32
RATE = 2e-3
SUPPRESSION_IOU = 0.6
MIN_SCORE = 1e-3
MAX_BOXES = 8


def main() -> int:
    """Trains, detects, and writes boxes, scores and timing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="data set with training and validation")
    parser.add_argument("--model", default="yolo11n")
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--out", type=Path, required=True, help="npz to write")
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    torch, model = build(arguments.model)
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(0)
    model, steps = train(torch, model, read_dataset(arguments.folder / "training"), 60.0 * arguments.minutes)
    validation = read_dataset(arguments.folder / "validation")
    boxes, scores = find(torch, model, validation.images)
    timing = speed(torch, model)
    about = {
        "model": arguments.model,
        "parameters": sum(p.numel() for p in model.parameters()),
        "steps": steps,
        "minutes": arguments.minutes,
        "ms_an_image": timing,
    }
    content = {f"boxes_{i}": b for i, b in enumerate(boxes)} | {f"scores_{i}": s for i, s in enumerate(scores)}
    content["about"] = np.array(json.dumps(about))
    np.savez(arguments.out, allow_pickle=False, **content)
    print(json.dumps(about, indent=1))
    return 0


def build(name: str) -> tuple[Any, Any]:
    """Torch and an untrained model of one class; a missing torchvision is replaced by an empty module."""
    with contextlib.suppress(ImportError, RuntimeError):
        importlib.import_module("torchvision")
    if "torchvision.ops" not in sys.modules:
        for module in ("torchvision", "torchvision.ops", "torchvision.transforms"):
            empty = types.ModuleType(module)
            empty.__spec__ = importlib.machinery.ModuleSpec(module, None)
            sys.modules[module] = empty
    torch = importlib.import_module("torch")
    tasks = importlib.import_module("ultralytics.nn.tasks")
    model = tasks.DetectionModel(f"{name}.yaml", ch=3, nc=1, verbose=False)
    model.args = importlib.import_module("ultralytics.cfg").get_cfg()
    return torch, model


def train(torch: Any, model: Any, data: DetectionDataset, limit_s: float) -> tuple[Any, int]:
    """Averaged weights after the time limit, and the number of steps: AdamW with warm-up and half a cosine."""
    optimiser = torch.optim.AdamW(model.parameters(), lr=RATE, weight_decay=5e-4)
    mean = deepcopy(model)
    begin, step = time.monotonic(), 0
    order: list[int] = []
    while (progress := (time.monotonic() - begin) / limit_s) < 1.0:
        rng = np.random.default_rng([0, step])
        if len(order) < BATCH:
            order = list(rng.permutation(len(data)))
        chosen, order = order[:BATCH], order[BATCH:]
        rate = RATE * min(1.0, (step + 1) / 200.0) * (0.505 + 0.495 * np.cos(np.pi * progress))
        for group in optimiser.param_groups:
            group["lr"] = rate
        model.train()
        loss, _ = model(as_targets(torch, augment_batch(data, np.array(chosen), rng)))
        optimiser.zero_grad()
        (loss.sum() * BATCH).backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
        optimiser.step()
        step += 1
        update_average(torch, mean, model, min(0.999, step / (step + 10.0)))
        if step % 100 == 0:
            print(
                step, round(time.monotonic() - begin), [round(float(x), 3) for x in loss], file=sys.stderr, flush=True
            )
    return mean.eval(), step


def update_average(torch: Any, mean: Any, model: Any, decay: float) -> None:
    """Updates the exponential moving average of weights and statistics."""
    with torch.no_grad():
        for slow, fast in zip(mean.state_dict().values(), model.state_dict().values(), strict=True):
            if slow.dtype.is_floating_point:
                slow.mul_(decay).add_(fast, alpha=1.0 - decay)


def as_targets(torch: Any, batch: Batch) -> dict[str, Any]:
    """A batch in the format of ultralytics: boxes by centre and size as fractions of the image."""
    size = batch.images.shape[1]
    index, place = np.nonzero(batch.weight > 0.0)
    box = batch.boxes[index, place] / size
    sides = np.column_stack([0.5 * (box[:, :2] + box[:, 2:]), box[:, 2:] - box[:, :2]])
    return {
        "img": torch.from_numpy(np.ascontiguousarray(batch.images.transpose(0, 3, 1, 2))),
        "cls": torch.zeros(len(index), 1),
        "bboxes": torch.from_numpy(sides.astype(np.float32)),
        "batch_idx": torch.from_numpy(index.astype(np.float32)),
    }


def find(torch: Any, model: Any, images: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Boxes and scores of images."""
    boxes, scores = [], []
    with torch.no_grad():
        for start in range(0, len(images), 50):
            part = torch.from_numpy(images[start : start + 50].transpose(0, 3, 1, 2).astype(np.float32) / 255.0)
            for raw in model(part)[0].numpy():
                box = np.column_stack(
                    [raw[0] - raw[2] / 2, raw[1] - raw[3] / 2, raw[0] + raw[2] / 2, raw[1] + raw[3] / 2]
                )
                kept = suppress(box, raw[4])
                boxes.append(box[kept].astype(np.float64))
                scores.append(raw[4][kept].astype(np.float64))
    return boxes, scores


def suppress(boxes: np.ndarray, scores: np.ndarray) -> list[int]:
    """Indices of the boxes kept by non-maximum suppression."""
    from rpojax.vision.intersection_over_union import pairwise_iou

    kept: list[int] = []
    for index in np.argsort(-scores)[:200]:
        if scores[index] < MIN_SCORE or len(kept) == MAX_BOXES:
            break
        if not kept or pairwise_iou(boxes[[index]], boxes[kept]).max() < SUPPRESSION_IOU:
            kept.append(int(index))
    return kept


def speed(torch: Any, model: Any) -> dict[str, float]:
    """Milliseconds per image of 128 px by batch size, without suppression; the best of several runs."""
    results = {}
    with torch.no_grad():
        for size in (1, 16, 64):
            images = torch.rand(size, 3, 128, 128)
            model(images)
            times = []
            for _ in range(10):
                begin = time.perf_counter()
                model(images)
                times.append((time.perf_counter() - begin) / size * 1e3)
            results[str(size)] = round(min(times), 3)
    return results


if __name__ == "__main__":
    sys.exit(main())
