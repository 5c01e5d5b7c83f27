"""Batches of augmented images, prepared ahead by threads."""

import collections
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from rpojax.runtime.jax_environment import available_cores
from rpojax.training.detector.augmentation import Batch, augment_batch
from rpojax.training.detector.training_options import NetworkTrainingOptions
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

_MAX_THREADS = 8


class BatchPrefetcher:
    """Batches from a step on, in order; without a time limit a batch depends on seed and step alone.

    `progress` is the fraction of the training that is done; whether batches are of crops follows it some steps later.
    As many threads prepare them as there are cores, so that an accelerator does not wait for one.
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
        self._threads = min(available_cores(), _MAX_THREADS)
        self._batches: collections.deque[Future[Batch]] = collections.deque()

    def next(self) -> Batch:
        """The batch of the next step."""
        self._fill()
        batch = self._batches.popleft().result()
        self._fill()
        return batch

    def _fill(self) -> None:
        """Has as many batches in preparation as there are threads, and two."""
        while len(self._batches) < self._threads + 2:
            self._batches.append(self._executor.submit(self._prepare, self._step, self.progress))
            self._step += 1

    def _prepare(self, step: int, clock: float) -> Batch:
        progress = step / (self._options.epochs * self._steps_per_epoch)
        if self._options.limit_s is not None:
            progress = max(progress, clock)
        indices = image_indices(len(self._data), self._options, self._steps_per_epoch, step)
        rng = np.random.default_rng([self._options.seed, 1, step])
        return augment_batch(self._data, indices, rng, crops=progress < self._options.pieces_share)

    def __enter__(self) -> "BatchPrefetcher":
        self._executor = ThreadPoolExecutor(self._threads, thread_name_prefix="augmentation")
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)


def image_indices(count: int, options: NetworkTrainingOptions, steps_per_epoch: int, step: int) -> np.ndarray:
    """Indices of the images of a step; an epoch has every image once."""
    epoch, place = divmod(step, steps_per_epoch)
    order = np.random.default_rng([options.seed, 0, epoch]).permutation(count)
    return order[place * options.batch : (place + 1) * options.batch]
