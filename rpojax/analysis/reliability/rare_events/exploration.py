"""Exploration: where failure lives, found by subset simulation and by scale annealing, which fail differently."""

from dataclasses import dataclass

import numpy as np

from rpojax.analysis.reliability.rare_events import scale_annealing, subset_simulation
from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints
from rpojax.analysis.reliability.rare_events.limit_state_calls import LimitStateCalls
from rpojax.analysis.reliability.rare_events.proposal_fit import WeightedFailures
from rpojax.analysis.reliability.rare_events.scale_annealing import AnnealingResult
from rpojax.analysis.reliability.rare_events.subset_simulation import SubsetResult

FIRST_SHARE = 0.08
"""Share of the budget for the first plain samples."""
_LEVEL_SHARE, _SUBSET_SHARE = 0.05, 0.35
_SCALE_SHARE, _ANNEALING_SHARE = 0.03, 0.25
_MIN_LEVEL, _MIN_SCALE = 20, 12
_OUTER_SHARE = 0.3
"""Factor on the weight of failures that only annealing found while it was wider than the nominal distribution."""


@dataclass(frozen=True)
class Exploration:
    """What was found.

    Attributes:
        subset: subset simulation
        annealing: scale annealing
    """

    subset: SubsetResult
    annealing: AnnealingResult

    @property
    def failures(self) -> WeightedFailures | None:
        """Failures that were found, each search with a weight as it has independent chains; None without any."""
        points, chains = self.subset.failures
        parts: list[tuple[np.ndarray, np.ndarray, float]] = []
        if len(points):
            parts.append((points.x, chains, float(len(np.unique(chains)))))
        outer = self.annealing.failures
        if len(outer):
            families = len(np.unique(self.annealing.families))
            share = families if self.annealing.probability is not None else _OUTER_SHARE * families
            x = outer.x if self.annealing.probability is not None else outer.x / self.annealing.scale**0.5
            parts.append((x, self.annealing.families, share))
        if not parts:
            return None
        x = np.concatenate([each for each, _, _ in parts])
        weights = np.concatenate([np.full(len(each), share / len(each)) for each, _, share in parts])
        groups = np.concatenate([chains + 10**6 * place for place, (_, chains, _) in enumerate(parts)])
        return WeightedFailures(x, weights, groups, self.subset.steepest)


def explore(calls: LimitStateCalls, rng: np.random.Generator, first: tuple[LatentPoints, np.ndarray]) -> Exploration:
    """Searches for failure from plain samples with their margins."""
    budget = calls.budget
    subset = subset_simulation.simulate(
        calls, rng, max(_MIN_LEVEL, int(_LEVEL_SHARE * budget)), int(_SUBSET_SHARE * budget), first
    )
    annealing = scale_annealing.anneal(
        calls, rng, max(_MIN_SCALE, int(_SCALE_SHARE * budget)), int(_ANNEALING_SHARE * budget)
    )
    return Exploration(subset, annealing)
