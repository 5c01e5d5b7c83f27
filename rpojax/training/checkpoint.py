"""Checkpoints of a training: a tree of arrays and its progress in one file."""

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.weight_files import WeightsError, read_tensors, write_tensors


def write_checkpoint(path: Path, key: str, content: Any, progress: Any) -> None:
    """Writes a tree of arrays and a progress that JSON can hold; `key` identifies the training."""
    leaves = {f"{index:04d}": np.asarray(leaf) for index, leaf in enumerate(jax.tree.leaves(content))}
    write_tensors(path, leaves, {"key": key, "progress": json.dumps(progress)})


def read_checkpoint(path: Path, key: str, like: Any) -> tuple[Any, Any] | None:
    """Arrays in the tree of `like`, and progress; None without an intact checkpoint of the training."""
    if not path.is_file():
        return None
    try:
        tensors, metadata = read_tensors(path)
    except WeightsError:
        return None
    leaves, structure = jax.tree.flatten(like)
    found = [tensors.get(f"{index:04d}") for index in range(len(leaves))]
    if (metadata.get("key"), "progress" in metadata) != (key, True) or any(
        f is None or f.shape != leaf.shape or f.dtype != leaf.dtype for f, leaf in zip(found, leaves, strict=True)
    ):
        return None
    return jax.tree.unflatten(structure, [jnp.asarray(values) for values in found]), json.loads(metadata["progress"])
