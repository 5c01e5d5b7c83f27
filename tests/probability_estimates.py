"""Content of an estimate of a probability of failure, and its page."""

from pathlib import Path
from typing import Any

from rpojax.report.page import probability_page

ESTIMATE: dict[str, Any] = {
    "probability": 1.2e-5,
    "interval_95": [1.0e-5, 1.4e-5],
    "coefficient_of_variation": 0.08,
    "evaluations": 20000,
    "method": "importance",
    "trusted": True,
    "warnings": ["several design points: 60 % at 4.20 sigmas, 40 % at 4.40 sigmas"],
    "reason": "a proposal fitted to the failures",
    "effective_sample_size": 150.0,
    "levels": [
        {"name": "level", "evaluations": 900, "probability": 0.1, "threshold": 2.5, "acceptance": 0.44},
        {"name": "level", "evaluations": 800, "probability": 0.2, "threshold": 1.5, "acceptance": 0.41},
        {"name": "level", "evaluations": 800, "probability": 6e-4, "threshold": 0.0, "acceptance": 0.4},
    ],
    "scenario": "inspection",
    "scenario_hash": "3f6c0a9d51e2" + 52 * "0",
    "seed": 5,
    "failure": {"metric": "min_range_m", "words": "min_range_m below 10 m, or undefined, as in a run that ended early"},
    "requirement": {"allowed_probability_of_failure": 1e-4, "verdict": "met"},
    "plain_runs_for_equal_accuracy": 13e6,
    "remark": "",
    "noise": "drawn with every run",
    "unmapped": [],
    "design_points": [
        {
            "distance_sigmas": 4.2,
            "share": 0.6,
            "dispersions": [
                {
                    "name": "servicer.mass_kg",
                    "distance_sigmas": 4.0,
                    "sigmas": {"servicer.mass_kg": 4.0},
                    "values": {"servicer.mass_kg": 31.2},
                    "nominal": {"servicer.mass_kg": 30.0},
                }
            ],
        }
    ],
    "failing_runs": [
        {"distance_sigmas": 4.3, "command": "rpojax run 01.toml --seed 0 --run-id 7 --out x", "dispersions": []}
    ],
}


def write_estimate(folder: Path) -> Path:
    """Writes the page of the estimate."""
    return probability_page.write_page(ESTIMATE, folder)
