"""Groups of metrics by what they measure, so that a reader opens those in question alone."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rpojax.metrics import (
    approach,
    attitude,
    camera_boxes,
    capture,
    filter_consistency,
    filter_likelihood,
    navigation_health,
    passive_safety,
    plume,
    position_errors,
    surface_coverage,
    target_attitude,
    team,
    thrusters,
    trajectory,
)

_GROUPS: Final = (
    ("Errors of position", (position_errors,)),
    ("At the docking port", (capture,)),
    ("Attitude of the target", (target_attitude,)),
    ("Consistency of the filter", (filter_consistency, filter_likelihood)),
    ("Confidence of the navigation", (navigation_health,)),
    ("Range and delta-v", (trajectory, approach, plume, thrusters)),
    ("Passive safety", (passive_safety,)),
    ("Pointing and wheels", (attitude,)),
    ("Camera", (camera_boxes,)),
    ("Inspection coverage", (surface_coverage,)),
    ("Team", (team,)),
)
_TITLES: Final = {metric.name: title for title, modules in _GROUPS for module in modules for metric in module.METRICS}
_REQUIRED, _OTHERS = "With a requirement", "Of plugins, and others"


@dataclass(frozen=True)
class MetricGroup:
    """A title, and the entries of the histograms of its metrics in display order."""

    title: str
    entries: list[dict[str, Any]]

    @property
    def names(self) -> str:
        """Titles of its metrics in a row."""
        return ", ".join(entry["metric"].title for entry in self.entries)


def histogram_groups(entries: Sequence[dict[str, Any]], required: Collection[str]) -> list[MetricGroup]:
    """Entries with a chart by group: those with a requirement first, whose names are `required`, then by subject."""
    found: dict[str, list[dict[str, Any]]] = {title: [] for title in (_REQUIRED, *(one for one, _ in _GROUPS), _OTHERS)}
    for entry in entries:
        if entry["chart"] is not None:
            name = str(entry["name"])
            title = _REQUIRED if name in required else _TITLES.get(name.partition("@")[0], _OTHERS)
            found[title].append(entry)
    return [MetricGroup(title, members) for title, members in found.items() if members]
