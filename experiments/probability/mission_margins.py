"""Margins of simulated runs of a scenario to a failure, as the scripts of this folder need them."""

import rpojax

rpojax.prepare_process()

from rpojax.analysis.reliability.search_settings import FailureChoice  # noqa: E402
from rpojax.analysis.reliability.simulated_failures.failure_margin import choose_failure  # noqa: E402
from rpojax.analysis.reliability.simulated_failures.simulated_margins import SimulatedMargins  # noqa: E402
from rpojax.scenario.dispersed_numbers import standard_normal_space  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402


def mission_margins(scenario: str, outcome: str, seed: int) -> SimulatedMargins:
    """Margins of runs of a scenario to an outcome, with the master seed of the runs."""
    file = scenario_loader.load(scenario, [])
    failure = choose_failure(file, FailureChoice(outcome=outcome))
    return SimulatedMargins(standard_normal_space.make_space(file), failure, seed)
