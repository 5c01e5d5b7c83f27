"""Exact bounds of violations at planned looks, so that verdicts on a share of runs keep their risks over all looks.

At each look a requirement is verified if at most `allowed` of the runs so far violate it, and refuted if at least
`refuting` do. Both are found by recursion over the binomial number of violations among the runs that no look has
decided yet, at the limit of the requirement (Armitage, McPherson and Rowe, J. R. Statist. Soc. A 132, 1969). Each side
has spent at most `risk * spent_share(t)` of its risk by the look at the fraction t of the plan (Lan and DeMets,
Biometrika 70, 1983, with the power family of Kim and DeMets, Biometrika 74, 1987). A higher rate of violations
delays no refutation and hastens no verification, so that the limit is the worst case of both sides.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.stats import binom

SPENDING_POWER: Final = 0.3
_BISECTIONS: Final = 40
_NEGLIGIBLE: Final = 1e-18
"""Probability of the ends of a binomial distribution that is left out, far below any risk."""


@dataclass(frozen=True)
class LookBounds:
    """Bounds of the violations at one look; None where the runs so far cannot give that verdict.

    Attributes:
        allowed: most violations with which the requirement is verified
        refuting: fewest violations with which it is refuted
    """

    allowed: int | None
    refuting: int | None


@dataclass(frozen=True)
class Decision:
    """First look that decided.

    Attributes:
        look: its number, from 1
        verified: whether the requirement is verified; else it is refuted
    """

    look: int
    verified: bool


def spent_share(fraction: float) -> float:
    """Share of the risk that may be spent by a fraction of the plan: a low power of it, to decide early."""
    return fraction**SPENDING_POWER


@lru_cache(maxsize=4096)
def look_bounds(
    runs: tuple[int, ...], fractions: tuple[float, ...], probability: float, risk: float
) -> tuple[LookBounds, ...]:
    """Bounds at each look.

    Args:
        runs: that count, up to each look; they may depend on chance, but not on violations
        fractions: of the plan at each look
        probability: demanded of a run without violation
        risk: of each of the two verdicts, if the probability is just that
    """
    bounds: list[LookBounds] = []
    # Probability of `first`, `first + 1`, ... violations without a decision so far.
    first, undecided = 0, np.ones(1)
    spent_low = spent_high = 0.0
    for number, before, fraction in zip(runs, (0, *runs), fractions, strict=False):
        added, steps = _binomial(number - before, 1.0 - probability)
        first, undecided = first + added, np.convolve(undecided, steps)
        budget = risk * spent_share(fraction)
        low = int(np.searchsorted(np.cumsum(undecided), budget - spent_low, side="right"))
        high = int(np.searchsorted(np.cumsum(undecided[::-1]), budget - spent_high, side="right"))
        high = min(high, len(undecided) - low)
        kept = slice(low, len(undecided) - high)
        spent_low += float(np.sum(undecided[:low]))
        spent_high += float(np.sum(undecided[kept.stop :]))
        bounds.append(LookBounds(first + low - 1 if low else None, first + kept.stop if high else None))
        first, undecided = first + low, undecided[kept]
        if not len(undecided):
            first, undecided = 0, np.zeros(1)
    return tuple(bounds)


def _binomial(runs: int, rate: float) -> tuple[int, np.ndarray]:
    """Least number of violations of `runs` that is likely enough to count, and the probabilities from it on."""
    if runs == 0:
        return 0, np.ones(1)
    low = int(binom.ppf(_NEGLIGIBLE, runs, rate))
    high = int(binom.isf(_NEGLIGIBLE, runs, rate)) + 1
    return max(0, low), binom.pmf(np.arange(max(0, low), min(runs, high) + 1), runs, rate)


def decide(bounds: Sequence[LookBounds], violations: Sequence[int]) -> Decision | None:
    """First look at which the `violations` up to it reach one of the bounds; None if none does."""
    for look, (bound, count) in enumerate(zip(bounds, violations, strict=False), start=1):
        if bound.allowed is not None and count <= bound.allowed:
            return Decision(look, verified=True)
        if bound.refuting is not None and count >= bound.refuting:
            return Decision(look, verified=False)
    return None


@dataclass(frozen=True)
class LookPath:
    """Runs that count and violations among them up to each look so far, for one requirement.

    Attributes:
        runs: that count, up to each look
        fractions: of the plan at each look
        violations: up to each look
    """

    runs: tuple[int, ...]
    fractions: tuple[float, ...]
    violations: tuple[int, ...]

    def bounds(self, probability: float, risk: float) -> tuple[LookBounds, ...]:
        """Bounds at each look so far."""
        return look_bounds(self.runs, self.fractions, probability, risk)

    def decision(self, probability: float, risk: float) -> Decision | None:
        """First look that decides a demanded probability at a risk."""
        return decide(self.bounds(probability, risk), self.violations)

    def success_bounds(self, probability: float, risk: float) -> tuple[float, float]:
        """Bounds of the probability of success, each wrong with at most `risk` however many looks there were.

        Largest probability that these looks verify and least that they refute, so that they agree with the decision on
        the demanded one (Jennison and Turnbull, J. R. Statist. Soc. B 51, 1989).
        """

        def is_verified(share: float) -> bool:
            found = self.decision(share, risk)
            return found is not None and found.verified

        def is_refuted(share: float) -> bool:
            found = self.decision(share, risk)
            return found is not None and not found.verified

        return _last_true(is_verified, probability, 0.0, 1.0), _last_true(is_refuted, probability, 1.0, 0.0)

    def risk_reached(self, probability: float, risk: float) -> float:
        """Smallest risk at which these looks would verify a demanded probability; 1 if none."""

        def is_verified(log_risk: float) -> bool:
            found = self.decision(probability, math.exp(log_risk))
            return found is not None and found.verified

        return math.exp(_last_true(is_verified, math.log(risk), 0.0, -40.0))


def _last_true(holds: Callable[[float], bool], known: float, true_end: float, false_end: float) -> float:
    """Where a condition stops to hold, between an end at which it does and one at which it does not (bisection).

    It is tested at the `known` place first, so that the result is on the same side of it as the condition says.
    """
    true, false = (known, false_end) if holds(known) else (true_end, known)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (true + false)
        true, false = (middle, false) if holds(middle) else (true, middle)
    return true


def fixed_runs(probability: float, risk: float, missed: float = 0.1, better: float = 0.25) -> int:
    """Fewest runs of a fixed plan that verifies with the consumer's `risk` a design that is clearly good enough.

    One that violates in a share `better` of the cases that it may, is missed with the producer's risk `missed`.
    """
    rate = 1.0 - probability
    for allowed in range(1000):
        # The fewest runs with which this number of violations is allowed (Hanson and Beard, NASA/TP-2010-216447).
        low, high = allowed + 1, allowed + 2
        while binom.cdf(allowed, high, rate) > risk:
            low, high = high + 1, 2 * high
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if binom.cdf(allowed, middle, rate) <= risk else (middle + 1, high)
        if binom.cdf(allowed, high, better * rate) >= 1.0 - missed:
            return high
    raise ValueError(f"probability {probability}, risk {risk}: found no plan")
