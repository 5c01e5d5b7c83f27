"""Where a campaign is, told from its manifests alone: at once, while others write, and free of jax."""

from pathlib import Path
from typing import Any

from rpojax.campaign.storage import block_manifests, campaign_json


def status(directory: Path) -> dict[str, Any]:
    """Blocks and runs done and missing, failures by reason, speed, and the report's path, None while there is none.

    Raises:
        ResultError: the folder is no campaign, or a manifest of it cannot be read.
    """
    asked = campaign_json.read(directory)
    blocks = campaign_json.block_count(asked)
    done = block_manifests.finished_blocks(directory, blocks)
    entries = block_manifests.read_all(directory, asked, done)
    page = directory / "report.html"
    ended = sum(entry.count for entry in entries)
    return {
        "directory": str(directory),
        "name": asked["name"],
        "blocks": {"total": blocks, "done": len(done), "missing": blocks - len(done)},
        "runs": {
            "requested": asked["runs"],
            "completed": sum(entry.completed for entry in entries),
            "failed": sum(entry.failed for entry in entries),
            "missing": asked["runs"] - ended,
        },
        "reasons": block_manifests.count_failure_reasons(entries),
        "begun": [
            {"block": block, "attempts": attempts}
            for block, attempts in block_manifests.attempts_at_unfinished_blocks(directory, blocks).items()
        ],
        "timing": block_manifests.timing(entries, _duration_s(asked)),
        "report": str(page) if page.is_file() else None,
    }


def _duration_s(asked: dict[str, Any]) -> float:
    found = asked["scenario"].get("duration_s", 0.0)
    return float(found) if isinstance(found, int | float) else 0.0
