"""Study of robustness: the margin of every believed quantity of a scenario, on both sides."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rpojax.analysis.robustness.assigned_runs import StudyProgress, check_study, provenance
from rpojax.analysis.robustness.believed_quantities import Quantity, find_quantities, with_handover
from rpojax.analysis.robustness.margin_search import SideSearch, StepVerdict, search
from rpojax.analysis.robustness.step_runs import (
    DEFAULT_PROBABILITY,
    DEFAULT_RISK,
    StepRuns,
    judge_step,
    requirement_names,
)
from rpojax.analysis.statistics.tolerance_bounds import runs_for_bound
from rpojax.campaign.storage.atomic_outputs import to_json_types
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import run_progress
from rpojax.scenario.schema import ScenarioFile

DEFAULT_RUNS: Final = 100
STUDY: Final = "study"
"""Name of what is no quantity in the content of a study."""
Side = tuple[str, str]
"""Name of a quantity, and of a side."""


def robustness(
    file: ScenarioFile,
    *,
    runs: int = DEFAULT_RUNS,
    seed: int = 0,
    free_drifts: bool = False,
    progress: bool = True,
) -> dict[str, Any]:
    """How far each quantity that the filter believes may be off before a requirement of the scenario breaks.

    Returns the content of robustness.json: margins by quantity, and under `study` steps, intervals and provenance.

    Args:
        file: the scenario
        runs: of each step
        seed: master seed; the runs of all steps have the same numbers
        free_drifts: judge requirements on free drifts and on coverage, too
        progress: show progress on stderr

    Raises:
        RpojaxError: an option is out of range, or all is broken at the nominal values.
    """
    check(file, runs, seed)
    whole = with_handover(file)
    quantities, left_out = find_quantities(whole)
    by_name = {each.name: each for each in quantities}
    sides = {(each.name, side): SideSearch(each.farthest(side)) for each in quantities for side in each.sides}
    simulated = StepRuns(whole, quantities, runs, seed, free_drifts)
    with run_progress(file.duration_s, quiet=not progress) as show:
        watch = StudyProgress(runs, show)
        watch.show(compiled=False)
        simulated.compile()
        watch.show(compiled=True)
        nominal = judge_step(file.requirements, simulated.simulate([(quantities[0], 0.0)], watch.round(1))[0])
        known = nominal.record["violations"]
        judged = [name for name in known if name not in nominal.broken]
        if not judged:
            broken = ", ".join(nominal.broken)
            raise RpojaxError(f"requirements: found all broken at nominal values ({broken}), expected one that holds")

        def evaluate(asked: Sequence[tuple[Side, float]]) -> list[StepVerdict]:
            steps = [(by_name[name], by_name[name].offset(side, size)) for (name, side), size in asked]
            results = simulated.simulate(steps, watch.round(len(steps)))
            return [judge_step(file.requirements, found, judged) for found in results]

        search(sides, evaluate)
    study = {
        **_provenance(file, runs, seed, free_drifts),
        "runs_simulated": watch.done,
        "judged": judged,
        "broken_at_nominal": list(nominal.broken),
        "not_judged": [
            each for each in requirement_names(file.requirements) if each not in nominal.record["violations"]
        ],
        "nominal": dict(nominal.record),
        "left_out": left_out,
        "quantities": {each.name: _details(each, sides) for each in quantities},
    }
    return to_json_types({**{each.name: _margins(each, sides) for each in quantities}, STUDY: study})


def check(file: ScenarioFile, runs: int, seed: int) -> None:
    """Refuses what cannot be studied, before anything is simulated.

    Raises:
        RpojaxError: naming the argument or the key.
    """
    check_study(file, "robustness", runs, seed)


def _provenance(file: ScenarioFile, runs: int, seed: int, free_drifts: bool) -> dict[str, Any]:
    needed = [runs_for_bound(each.probability, 1.0 - each.consumer_risk) for each in file.requirements]
    decide = max(needed, default=runs_for_bound(DEFAULT_PROBABILITY, 1.0 - DEFAULT_RISK))
    return {**provenance(file, runs, seed, free_drifts), "runs_that_decide": decide}


def _margins(quantity: Quantity, sides: Mapping[Side, SideSearch]) -> dict[str, Any]:
    """What others read of a quantity: margins in its unit, None where nothing breaks."""
    low, high = _both(quantity, sides)
    return {
        "unit": quantity.unit,
        "believed_sigma": quantity.believed_sigma,
        "low_margin": None if low.breaks is None else _in_unit(quantity, low.holds),
        "high_margin": None if high.breaks is None else _in_unit(quantity, high.holds),
        "requirement": {"low": low.requirement, "high": high.requirement},
    }


def _both(quantity: Quantity, sides: Mapping[Side, SideSearch]) -> tuple[SideSearch, SideSearch]:
    """Searches to the low and to the high side: the same one where a quantity is turned in any direction."""
    own = [sides[quantity.name, side] for side in quantity.sides]
    return own[0], own[-1]


def _details(quantity: Quantity, sides: Mapping[Side, SideSearch]) -> dict[str, Any]:
    """Everything about the search for the margins of a quantity."""
    low, high = _both(quantity, sides)
    return {
        "title": quantity.title,
        "nominal": quantity.nominal,
        "belief": quantity.belief,
        "sides": list(quantity.sides),
        **_interval("low", low, quantity),
        **_interval("high", high, quantity),
        "steps": [
            {
                "side": side,
                "sigmas": size,
                "offset": _in_unit(quantity, -size if side == "low" else size),
                "broken": list(step.broken),
                **step.record,
            }
            for side in quantity.sides
            for size, step in sorted(sides[quantity.name, side].steps.items())
        ],
    }


def _interval(side: str, found: SideSearch, quantity: Quantity) -> dict[str, Any]:
    """Last step that holds, first that breaks, and between which steps the margin lies with confidence, in the unit."""
    return {
        f"{side}_holds_to": _in_unit(quantity, found.holds),
        f"{side}_breaks_at": _in_unit(quantity, found.breaks),
        f"{side}_interval": [_in_unit(quantity, size) for size in found.interval],
    }


def _in_unit(quantity: Quantity, size: float | None) -> float | None:
    """A size in sigmas in the unit of a quantity, without the last digits, which are rounding."""
    return None if size is None else float(f"{size * quantity.believed_sigma:.12g}")
