"""Options and progress of the training of one network of the detector."""

import dataclasses
from collections.abc import Callable


@dataclasses.dataclass(frozen=True)
class NetworkTrainingOptions:
    """Options of a training.

    Attributes:
        epochs: passes over the data
        batch: images per step
        seed: seed of all random numbers
        rate: peak learning rate
        limit_s: wall-clock limit [s]
        pieces_share: fraction of the training, at its start, on crops of the images at a quarter of the cost
    """

    epochs: int = 100
    batch: int = 32
    seed: int = 0
    rate: float = 5e-3
    limit_s: float | None = None
    pieces_share: float = 0.5


@dataclasses.dataclass(frozen=True)
class NetworkTrainingProgress:
    """Progress of a training: steps done of how many, metrics on the validation images, elapsed time [s]."""

    done: int
    total: int
    map50: float
    map50_95: float
    elapsed_s: float


OnNetworkProgress = Callable[[NetworkTrainingProgress], None]
