"""Training of a network by epochs, data parallel over the devices; an interrupted one continues from its checkpoint."""

import dataclasses
import hashlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import jax
import numpy as np

from rpojax.runtime.device_mesh import DeviceMesh
from rpojax.training import checkpoint as checkpoints
from rpojax.training.training_steps import (
    Batch,
    BatchPrefetcher,
    Loss,
    Params,
    TrainingState,
    apply_channel_gains,
    first_state,
    optimizer,
    step_settings,
    training_step,
)


@runtime_checkable
class Options(Protocol):
    """Options that every training has: passes over the data, items per step, seed, peak learning rate, limit [s]."""

    @property
    def epochs(self) -> int: ...
    @property
    def batch(self) -> int: ...
    @property
    def seed(self) -> int: ...
    @property
    def rate(self) -> float: ...
    @property
    def limit_s(self) -> float | None: ...


@runtime_checkable
class Progress(Protocol):
    """Progress of a training after an epoch: steps done, and elapsed time [s]. A data class that JSON can hold."""

    @property
    def done(self) -> int: ...
    @property
    def elapsed_s(self) -> float: ...


Entry = TypeVar("Entry", bound=Progress)


@dataclass(frozen=True)
class Training(Generic[Batch]):
    """What stays the same from step to step.

    Attributes:
        loss: of the network's parameters
        frozen: parameters that the loss has besides
        options: of the training
        count: items of the data; an epoch has every one once, up to the rest of a batch
        prepare: the batch of a step, given the items of that step, the step, and the fraction of the training done
    """

    loss: Loss
    frozen: Any
    options: Options
    count: int
    prepare: Callable[[np.ndarray, int, float], Batch]

    @property
    def steps_per_epoch(self) -> int:
        """Steps of a pass over the data."""
        return max(1, self.count // self.options.batch)

    @property
    def steps(self) -> int:
        """Steps of the whole training."""
        return self.options.epochs * self.steps_per_epoch

    def progress(self, done: int, elapsed_s: float) -> float:
        """Fraction of the training that is done, by steps or by time."""
        limit_s = self.options.limit_s
        return max(done / self.steps, 0.0 if limit_s is None else elapsed_s / limit_s)

    def items(self, step: int) -> np.ndarray:
        """Numbers of the items of a step, which depend on the seed and the step alone."""
        epoch, place = divmod(step, self.steps_per_epoch)
        order = np.random.default_rng([self.options.seed, 0, epoch]).permutation(self.count)
        return order[place * self.options.batch : (place + 1) * self.options.batch]

    def batch(self, step: int, progress: float) -> Batch:
        """The batch of a step."""
        return self.prepare(self.items(step), step, progress)


def train_by_epochs(
    training: Training[Any],
    start: Params,
    judge: Callable[[Params], dict[str, Any]],
    entry: Callable[..., Entry],
    checkpoint: Path | None,
    key: str,
    on_progress: Callable[[Entry], None],
) -> tuple[Params, list[Entry]]:
    """Trains a network from `start`; returns the averaged weights, and the progress after each epoch.

    With a checkpoint an interrupted call continues after its last epoch, to the same result. With a time limit the
    learning rate schedule ends at the limit.

    Args:
        training: what stays the same
        start: parameters before the first step
        judge: what an entry of the progress has besides, from averaged weights
        entry: its class
        checkpoint: file, None without one
        key: of the training, which its checkpoint has
        on_progress: told of each epoch
    """
    start_time = time.monotonic()
    state, history = first_state(start), list[Entry]()
    done, progress = 0, 0.0
    if checkpoint and (found := checkpoints.read_checkpoint(checkpoint, key, state.arrays())):
        state, history = TrainingState(*found[0]), [entry(**stored) for stored in found[1]]
        done, start_time = history[-1].done, start_time - history[-1].elapsed_s
        progress = training.progress(done, history[-1].elapsed_s)
    mesh = DeviceMesh(jax.devices()[: math.gcd(training.options.batch, jax.device_count())])
    # Where each step leaves it: otherwise the step would be compiled again for the second one.
    state = TrainingState(*mesh.copy(state.arrays()))
    steps = _Steps(training, mesh, mesh.copy(training.frozen))
    with BatchPrefetcher(training.batch, done, progress) as batches:
        while done < training.steps and progress < 1.0:
            state, done, progress = _run_epoch(steps, state, batches, done, progress, start_time)
            elapsed_s = time.monotonic() - start_time
            judged = judge(jax.device_get(apply_channel_gains(state.averaged_params)))
            history.append(entry(done=done, total=training.steps, elapsed_s=elapsed_s, **judged))
            if checkpoint:
                stored: Any = history
                entries = [dataclasses.asdict(each) for each in stored]
                checkpoints.write_checkpoint(checkpoint, key, state.arrays(), entries)
            on_progress(history[-1])
    return apply_channel_gains(state.averaged_params), history


@dataclass(frozen=True)
class _Steps:
    """A training on as many devices as divide the number of items of a batch, which have its frozen parameters."""

    training: Training[Any]
    mesh: DeviceMesh
    frozen: Any

    def after(self, state: TrainingState, batch: Any, done: int, progress: float) -> TrainingState:
        """State after one more step."""
        settings = step_settings(self.training.options.rate, progress, done)
        whole = self.mesh.copy((settings, jax.random.key(done)))
        arrays = self.mesh.place(batch)
        step = training_step(self.training.loss, _OPTIMIZER, state.arrays(), self.frozen, *whole, arrays)
        # One at a time: with several in flight and few cores, the parts of one may wait for those of another for ever.
        return TrainingState(*jax.block_until_ready(step))


_OPTIMIZER = optimizer()


def _run_epoch(
    steps: _Steps,
    state: TrainingState,
    batches: BatchPrefetcher[Any],
    done: int,
    progress: float,
    start_time: float,
) -> tuple[TrainingState, int, float]:
    """State, steps done and progress after one epoch, or at the time limit."""
    for _ in range(steps.training.steps_per_epoch):
        batches.progress = progress
        state = steps.after(state, batches.next(), done, progress)
        done += 1
        progress = steps.training.progress(done, time.monotonic() - start_time)
        if progress >= 1.0:
            break
    return state, done, progress


def training_key(options: Any, count: int, weights: Any, data: Sequence[np.ndarray]) -> str:
    """Key of a training for its checkpoint: options but the time limit, first weights and parts of the `data`."""
    digest = hashlib.sha256(repr((dataclasses.replace(options, limit_s=None), count)).encode())
    for leaf in jax.tree.leaves(weights):
        digest.update(np.asarray(leaf).tobytes())
    for each in data:
        digest.update(each.tobytes())
    return digest.hexdigest()
