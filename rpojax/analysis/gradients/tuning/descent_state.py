"""State of a gradient descent, and the file from which an interrupted one is resumed."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from rpojax.campaign.storage import atomic_files
from rpojax.errors import ResultError
from rpojax.untrusted.file_reading import FileKind


@dataclass(frozen=True)
class TuningStep:
    """Record of one step.

    Attributes:
        objective: its value
        parts: of it, without their weights
        undefined: by part, runs without a value of it, which count as the worst
        gradient_norm: of the mean over runs
        left_out: runs without a finite gradient
        shortened: runs whose gradient was clipped
        run_s: time without compilation [s]
    """

    objective: float
    parts: dict[str, float]
    undefined: dict[str, int]
    gradient_norm: float
    left_out: int
    shortened: int
    run_s: float


@dataclass(frozen=True)
class DescentState:
    """State between two steps.

    Attributes:
        coordinates: (k,) present iterate
        optimizer_leaves: leaves of the state of Adam
        iterate_sum: (k,) sum of the averaged iterates so far
        steps: made so far
    """

    coordinates: np.ndarray
    optimizer_leaves: list[np.ndarray]
    iterate_sum: np.ndarray
    steps: tuple[TuningStep, ...]


def initial_state(optimizer: Any, x: np.ndarray) -> DescentState:
    """State before the first step at coordinates `x` (k,)."""
    return DescentState(x, [np.asarray(leaf) for leaf in jax.tree.leaves(optimizer.init(x))], np.zeros_like(x), ())


def load_state(progress_file: Path, initial: DescentState, identity: dict[str, Any]) -> DescentState:
    """State in a file, of the same structure as an initial one.

    Raises:
        ResultError: the file holds none, or that of a tuning with another identity.
    """
    content = atomic_files.read_json(progress_file, "the progress of a tuning", FileKind.PROGRESS)
    another = f"{progress_file}: found the progress of another tuning, expected that of this one"
    try:
        if content["of"] != identity:
            raise ResultError(another)
        leaves = [
            np.asarray(leaf, dtype=kind.dtype).reshape(kind.shape)
            for leaf, kind in zip(content["optimizer"], initial.optimizer_leaves, strict=True)
        ]
        steps = tuple(TuningStep(**step) for step in content["steps"])
        coordinates, iterate_sum = (np.asarray(content[name], dtype=float) for name in ("x", "tail"))
    except (KeyError, TypeError, ValueError) as error:
        raise ResultError(f"{progress_file}: found {error!r}, expected the progress of a tuning") from None
    if coordinates.shape != initial.coordinates.shape:
        raise ResultError(another)
    return DescentState(coordinates, leaves, iterate_sum, steps)


def save_state(progress_file: Path, identity: dict[str, Any], state: DescentState) -> None:
    """Writes a state, and the identity of its tuning."""
    content = {
        "of": identity,
        "x": state.coordinates.tolist(),
        "optimizer": [leaf.tolist() for leaf in state.optimizer_leaves],
        "tail": state.iterate_sum.tolist(),
        "steps": [asdict(step) for step in state.steps],
    }
    atomic_files.write_json(progress_file, content)
