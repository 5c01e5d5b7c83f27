"""Sentences and table rows of an estimated probability of failure."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.report.number_format import format_number

_MOST_DISPERSIONS = 6
_VERDICTS = {
    "met": "the requirement is met",
    "violated": "the requirement is violated",
    "open": "the requirement is left open",
}


def sentences(content: Mapping[str, Any]) -> list[str]:
    """The estimate in words: probability, requirement, accuracy, method, and what speaks against it."""
    low, high = content["interval_95"]
    cov = content["coefficient_of_variation"]
    found = [
        f"{content['failure']['words']}: probability {content['probability']:.3g}, "
        f"95 % interval {low:.3g} to {high:.3g}{'' if content['trusted'] else '; NOT trusted'}",
    ]
    requirement = content["requirement"]
    if requirement is not None:
        allowed = requirement["allowed_probability_of_failure"]
        found.append(f"allowed is {allowed:.3g}: {_VERDICTS[requirement['verdict']]}")
    accuracy = "no coefficient of variation" if cov is None else f"coefficient of variation {100.0 * cov:.2g} %"
    equal = content["plain_runs_for_equal_accuracy"]
    against = "" if equal is None else f"; plain sampling would take {equal:,.0f} runs"
    found.append(f"{content['evaluations']} simulated runs by method {content['method']}, {accuracy}{against}")
    found.append(f"method: {content['reason']}")
    found += [f"note: {warning}" for warning in content["warnings"]]
    if content["remark"]:
        found.append(f"note: {content['remark']}")
    return found


def level_rows(levels: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Rows of the stages of an estimate: name, runs, probability, margin, acceptance of chains."""
    return [
        [
            level["name"],
            str(level["evaluations"]),
            _short(level["probability"]),
            format_number(level["threshold"]),
            format_number(level["acceptance"], 2),
        ]
        for level in levels
    ]


def design_point_rows(points: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Design points with the dispersions that are farthest from their median."""
    return [
        {
            "distance": f"{point['distance_sigmas']:.2f}",
            "share": f"{100.0 * point['share']:.0f} %",
            "dispersions": [_dispersion_cells(each) for each in point["dispersions"][:_MOST_DISPERSIONS]],
        }
        for point in points
    ]


def failing_run_rows(runs: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Rows of the most likely failing runs: distance, what is unusual in them, command."""
    return [
        [
            f"{run['distance_sigmas']:.2f}",
            "; ".join(f"{each['name']} {_numbers(each['sigmas'].values(), '+.1f')}" for each in run["dispersions"][:3]),
            run["command"],
        ]
        for run in runs
    ]


def _dispersion_cells(entry: Mapping[str, Any]) -> list[str]:
    """Name, sigmas, value and nominal value of a dispersion."""
    values, nominal = (
        _numbers(np.concatenate([np.ravel(each) for each in entry[side].values()]).tolist(), ".5g")
        for side in ("values", "nominal")
    )
    return [entry["name"], _numbers(entry["sigmas"].values(), "+.2f"), values, nominal]


def _numbers(values: Any, form: str) -> str:
    return ", ".join(format(value, form) for value in values)


def _short(value: float | None) -> str:
    return format_number(None) if value is None or not math.isfinite(value) else f"{value:.3g}"
