"""Record of a worst case: the most likely violation of a limit, and the files that hold it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from rpojax.analysis.reliability.evaluation_log import EvaluatedPoint, SearchResult
from rpojax.analysis.reliability.metric_limit import MetricLimit
from rpojax.analysis.reliability.simulated_limit_state import EvaluationCosts
from rpojax.campaign.storage.atomic_outputs import check_replaceable, write_atomically, write_json
from rpojax.campaign.storage.json_types import to_json_types
from rpojax.optional_packages import require_package
from rpojax.scenario.dispersed_numbers import dispersion_keys, standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.parameter_keys import nominal_value, parse_key
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.scenario.schema import ScenarioFile

if TYPE_CHECKING:
    import pandas

_OF_DISPERSION = ("name", "kind", "distance_sigmas")
SCENARIO_NAME, RECORD_NAME = "worst_case.toml", "worst_case.json"


@dataclass(frozen=True)
class WorstCase:
    """The most likely violation of a limit that was found, or the closest approach to it.

    Attributes:
        limit: of the metric
        space: standard normal variables of the scenario
        seed: of the campaign
        search: its result, in those variables
        costs: of runs and gradients
        compile_s: compilation [s]
        values: of the dispersed keys at the reported point, in the user's units
        simulated_value: metric of the confirming run, not a number where it failed; None before it is simulated
    """

    limit: MetricLimit
    space: StandardNormalSpace
    seed: int
    search: SearchResult
    costs: EvaluationCosts
    compile_s: float
    values: dict[str, Any]
    simulated_value: float | None = None

    @property
    def reported_point(self) -> EvaluatedPoint:
        """The nearest violation, or the point with the smallest margin where there is none."""
        return self.search.nearest_violation or self.search.smallest_margin

    @property
    def _unit(self) -> str:
        return plugin_registry.catalogue_of(self.space.file)[self.limit.metric].unit

    @property
    def probability(self) -> float | None:
        """First-order probability of a violation in runs with this run's noise; None without a violation."""
        return None if self.search.nearest_violation is None else float(ndtr(-self.search.nearest_violation.distance))

    @property
    def pinned_scenario(self) -> ScenarioFile:
        """The scenario with the dispersions of the reported point as choices of one value."""
        return standard_normal_space.with_fixed_values(self.space, self.values)

    @property
    def confirmed(self) -> bool:
        """Whether a violation was found and the confirming run violates the limit, too."""
        if self.search.nearest_violation is None or self.simulated_value is None:
            return False
        return not math.isfinite(self.simulated_value) or self.limit.is_violated(self.simulated_value)

    @property
    def undefined(self) -> bool:
        """Whether what was found is a run without a value of the metric, which no limit bounds."""
        found = self.search.nearest_violation
        return found is not None and not math.isfinite(self.limit.value_at_margin(found.margin))

    def to_dict(self) -> dict[str, Any]:
        """Content of worst_case.json, in the types of JSON."""
        search, limit, point = self.search, self.limit, self.reported_point
        content = {
            "scenario": self.space.file.name,
            "metric": limit.metric,
            "unit": self._unit,
            "bound": limit.bound,
            "limit": limit.limit,
            "seed": self.seed,
            "run_id": point.replicate,
            "found": search.nearest_violation is not None,
            "distance_sigmas": point.distance,
            "probability_first_order": self.probability,
            "alignment": search.alignment,
            "value": limit.value_at_margin(point.margin),
            "value_flown": self.simulated_value,
            "confirmed": self.confirmed,
            "undefined": self.undefined,
            "dispersions": self._dispersions(),
            "held": list(self.space.unmapped),
            "cost": self._cost(),
        }
        return to_json_types(content)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Dispersed numbers of the reported point, the farthest from their median first, in the users' units.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        rows = [
            {"key": key + place, "value": value, "nominal": nominal} | {name: entry[name] for name in _OF_DISPERSION}
            for entry in self._dispersions()
            for key, values in entry["values"].items()
            for place, value, nominal in _components(values, entry["nominal"][key])
        ]
        return require_package("pandas").DataFrame(rows, columns=["key", "value", "nominal", *_OF_DISPERSION])

    def write(self, directory: Path | str, force: bool = False) -> None:
        """Writes worst_case.toml, a scenario to simulate, and worst_case.json into a folder.

        Raises:
            OutputError: a file exists and is not to be replaced by `force`, or cannot be written.
        """
        directory = Path(directory)
        check_replaceable((directory / SCENARIO_NAME, directory / RECORD_NAME), force)
        write_atomically(directory / SCENARIO_NAME, self._scenario_text(directory).encode())
        write_json(directory / RECORD_NAME, self.to_dict())

    def _scenario_text(self, directory: Path) -> str:
        """The pinned scenario as TOML, with the command that simulates it."""
        import tomli_w

        limit, point = self.limit, self.reported_point
        what = "breaks" if self.search.nearest_violation is not None else "comes closest to breaking"
        command = command_line(
            "run",
            (directory / SCENARIO_NAME).absolute(),
            *("--seed", self.seed, "--run-id", point.replicate, "--out", "DIR"),
            plugin=self.space.file.plugin,
        )
        head = (
            f"# Run {point.replicate} of seed {self.seed} {what} {limit.metric} {limit.bound} "
            f"{limit.limit:g} {self._unit}, {point.distance:.2f} sigmas from the median run.\n"
            f"# {command}\n\n"
        )
        return head + tomli_w.dumps(self.pinned_scenario.model_dump(mode="json"))

    def _dispersions(self) -> list[dict[str, Any]]:
        """Mapped dispersions with their values and sigmas, the farthest from their median first."""
        space, z = self.space, self.reported_point.z
        entries = []
        for entry in space.mapped:
            name = entry.name
            rows = space.slices[name]
            keys = list(dict.fromkeys(parameter.key for parameter in dispersion_keys.assigned_keys(entry)))
            entries.append(
                {
                    "name": name,
                    "kind": entry.kind,
                    "distance_sigmas": float(np.linalg.norm(z[rows])),
                    "sigmas": dict(zip(space.labels[rows], z[rows].tolist(), strict=True)),
                    "values": {key: self.values[key].tolist() for key in keys},
                    "nominal": {key: nominal_value(space.file, parse_key(key)) for key in keys},
                }
            )
        return sorted(entries, key=lambda each: -each["distance_sigmas"])

    def _cost(self) -> dict[str, Any]:
        search, costs = self.search, self.costs
        return {
            "run_equivalents": search.cost,
            "run_equivalents_to_first_violation": (
                None if search.first_violation is None else search.first_violation.cost
            ),
            "flights": search.margin_evaluations,
            "gradients": search.gradient_evaluations,
            "batch": costs.batch_size,
            "flight_s": costs.run_s,
            "gradient_s": costs.gradient_s,
            "gradient_flights": costs.gradient_run_equivalents,
            "compile_s": self.compile_s,
        }


def _components(values: Any, nominal: Any) -> Iterator[tuple[str, float, float]]:
    """Place, value and nominal value of each number of a key: an empty place of a number alone, else `[0]`, ..."""
    found, expected = np.asarray(values), np.asarray(nominal)
    expected = np.broadcast_to(expected, found.shape) if expected.size == 1 else expected.reshape(found.shape)
    for place in np.ndindex(found.shape):
        yield "".join(f"[{index}]" for index in place), found[place].item(), expected[place].item()
