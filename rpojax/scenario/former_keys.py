"""Keys of scenarios that have another meaning and name today, so that an old file is refused with the reason."""

from typing import Final

_FORMER_KEYS: Final = {
    "navigation.confirm_frames": "navigation.confirm_within_s, which counts seconds",
    "navigation.confirm_tolerance_px": "navigation.confirm_tolerance_deg_s, an angle per second",
    "navigation.confirm_tolerance_px_s": "navigation.confirm_tolerance_deg_s, an angle, the same for every camera",
    "navigation.rejections_before_recovery": "navigation.recovery_after_s, which counts seconds",
}


def replacement(key: str) -> str | None:
    """The key that has replaced a former `key`, with the difference, or None for any other key."""
    if key.startswith("fault."):
        return f"faults.NAME.{key.removeprefix('fault.')}, a key of one of the list [[faults]]"
    return _FORMER_KEYS.get(key)
