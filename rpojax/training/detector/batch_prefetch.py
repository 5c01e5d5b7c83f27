"""Batches of augmented images, prepared ahead by a thread."""

import queue
import threading

import numpy as np

from rpojax.training.detector.augmentation import Batch, augment_batch
from rpojax.training.detector.training_options import NetworkTrainingOptions
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset


class BatchPrefetcher:
    """Batches from a step on; without a time limit a batch depends on seed and step alone.

    `progress` is the fraction of the training that is done; whether batches are of crops follows it some steps later.
    """

    def __init__(
        self,
        data: DetectionDataset,
        options: NetworkTrainingOptions,
        steps_per_epoch: int,
        first_step: int,
        progress: float,
    ) -> None:
        self.progress = progress
        self._data, self._options, self._steps_per_epoch, self._step = data, options, steps_per_epoch, first_step
        self._batches: queue.Queue[Batch] = queue.Queue(maxsize=4)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def next(self) -> Batch:
        """The batch of the next step."""
        while True:
            try:
                return self._batches.get(timeout=10.0)
            except queue.Empty:
                if not self._thread.is_alive():
                    raise RuntimeError("the thread that prepares batches has ended") from None

    def _run(self) -> None:
        while not self._ended.is_set():
            batch = self._prepare(self._step)
            self._step += 1
            while not self._ended.is_set():
                try:
                    self._batches.put(batch, timeout=0.2)
                    break
                except queue.Full:
                    continue

    def _prepare(self, step: int) -> Batch:
        progress = step / (self._options.epochs * self._steps_per_epoch)
        if self._options.limit_s is not None:
            progress = max(progress, self.progress)
        indices = image_indices(len(self._data), self._options, self._steps_per_epoch, step)
        rng = np.random.default_rng([self._options.seed, 1, step])
        return augment_batch(self._data, indices, rng, crops=progress < self._options.pieces_share)

    def __enter__(self) -> "BatchPrefetcher":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()


def image_indices(count: int, options: NetworkTrainingOptions, steps_per_epoch: int, step: int) -> np.ndarray:
    """Indices of the images of a step; an epoch has every image once."""
    epoch, place = divmod(step, steps_per_epoch)
    order = np.random.default_rng([options.seed, 0, epoch]).permutation(count)
    return order[place * options.batch : (place + 1) * options.batch]
