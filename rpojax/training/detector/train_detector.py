"""Training of the detector: the first look at whole pictures, then the second one at the boxes that the first names."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax

from rpojax.training.detector import evaluate_detector, proposal_loss, refinement_loss
from rpojax.training.detector.training_loop import Recipe, Step, descend
from rpojax.training.synthetic_data.detection_dataset import Dataset
from rpojax.vision.detector import proposal_network
from rpojax.vision.detector.two_stage_detector import Params, detect, fresh

OnStep = Callable[[str, Step], None]
"""Called after every pass with the look that is trained."""


def train(
    data: Dataset,
    held_out: Dataset,
    first: Recipe,
    second: Recipe,
    checkpoint: Path | None = None,
    on_step: OnStep = lambda look, step: None,
    start: Params | None = None,
) -> tuple[Params, dict[str, list[Step]]]:
    """Trains both looks on a data set and returns them with the history of checks on another one.

    They begin with the weights `start`, or untrained. With a checkpoint an interrupted call goes on after the last
    finished pass, to the same result.
    """
    start = start or fresh(jax.random.key(first.seed))
    files = {look: checkpoint and checkpoint.with_name(f"{checkpoint.name}.{look}") for look in start}

    def judge_first(params: Any) -> dict[str, Any]:
        return evaluate_detector.figures(
            evaluate_detector.find(params, held_out.images, proposal_network.detect), held_out
        )

    wide, early = descend(
        proposal_loss.loss,
        start["first"],
        (),
        data,
        first,
        judge_first,
        files["first"],
        lambda step: on_step("first", step),
    )

    def judge_both(params: Any) -> dict[str, Any]:
        both = {"first": wide, "second": params}
        return evaluate_detector.figures(evaluate_detector.find(both, held_out.images, detect), held_out)

    near, late = descend(
        refinement_loss.loss,
        start["second"],
        wide,
        data,
        second,
        judge_both,
        files["second"],
        lambda step: on_step("second", step),
    )
    return {"first": wide, "second": near}, {"first": early, "second": late}


def forget(checkpoint: Path) -> None:
    """Removes the checkpoints of a training that is over."""
    for look in ("first", "second"):
        checkpoint.with_name(f"{checkpoint.name}.{look}").unlink(missing_ok=True)


def card(
    data: Dataset,
    recipes: Mapping[str, Recipe],
    history: Mapping[str, list[Step]],
    figures: Mapping[str, Any],
    command: str,
) -> dict[str, Any]:
    """What to say about a detector: how it was made, and its figures on pictures held out."""
    return {
        "images": len(data),
        "size_px": int(data.images.shape[1]),
        "recipe": {look: dataclasses.asdict(recipe) for look, recipe in recipes.items()},
        "steps_done": {look: steps[-1].done if steps else 0 for look, steps in history.items()},
        "training_s": round(sum(steps[-1].elapsed_s for steps in history.values() if steps), 1),
        "held_out": dict(figures),
        "command": command,
    }
