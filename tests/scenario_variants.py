"""Variants of a scenario: with another design, other dispersions or sections, and files with a case table."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

TABLE = "gps.noise_m, formation.desired_position_m[1] ,faults.fault.kind\n1.5,-30,none\n 2e0 ,-.25e2,gps_outage\n\n"
"""Case table of two runs."""


_FAULT = {"faults": [{"name": "fault", "kind": "none"}]}
"""A fault, whose keys can be varied."""


def with_design(file: ScenarioFile, **settings: Any) -> ScenarioFile:
    """`file` with another design, validated."""
    return scenario_loader.validate(file.model_dump() | _FAULT | {"design": settings})


def with_dispersions(file: ScenarioFile, *entries: BaseModel | dict[str, Any]) -> ScenarioFile:
    """`file` with other dispersions, validated."""
    tables = [entry.model_dump() if isinstance(entry, BaseModel) else entry for entry in entries]
    return scenario_loader.validate(file.model_dump() | _FAULT | {"dispersions": tables})


def with_sections(file: ScenarioFile, **tables: Any) -> ScenarioFile:
    """`file` with other sections, without dispersions by default, validated."""
    return scenario_loader.validate(file.model_dump() | {"dispersions": []} | tables)


def correlated(keys: list[str], covariance: list[list[float]]) -> dict[str, Any]:
    """Table of a correlated normal dispersion."""
    return {"kind": "correlated_normal", "keys": keys, "covariance": covariance}


def derived(key: str, *terms: str, offset: Any = 0.0) -> dict[str, Any]:
    """Table of a derived dispersion with factors of 1."""
    return {"kind": "derived", "key": key, "offset": offset, "terms": [{"key": term, "factor": 1.0} for term in terms]}


def write_with_table(folder: Path, text: str, design: str = 'kind = "table"\nfile = "runs.csv"\n') -> Path:
    """Writes a scenario with the case table `text`; path of the scenario."""
    (folder / "runs.csv").write_text(text)
    (folder / "mine.toml").write_text(
        f'extends = "inspection"\n[[faults]]\nname = "fault"\nkind = "none"\n[design]\n{design}'
    )
    return folder / "mine.toml"
