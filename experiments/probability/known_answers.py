"""Estimates of known probabilities over many seeds: coverage of the intervals, accuracy, and how many are trusted."""

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import known_problems
import numpy as np
from jaxtyping import Array
from known_problems import Problem
from scipy.stats import norm

from rpojax.analysis.reliability.rare_events.estimate_probability import estimate_probability
from rpojax.analysis.reliability.rare_events.probability_estimate import MethodChoice, ProbabilityEstimate

LISTED = {"RP107": 2.92e-7, "RP111": 7.65e-7, "RP77": 2.87e-7}
"""Values of the public benchmark that quadrature does not confirm."""
NOISE = 0.5
"""Standard deviation of the noise that is added to margins."""


def noisy(problem: Problem) -> tuple[Callable[[Array, Array], Array], float]:
    """A problem of two dimensions with a noise term in its margin, and its probability by quadrature."""
    axis = np.linspace(-8.5, 8.5, 3001)
    weights = norm.pdf(axis) * (axis[1] - axis[0])
    total = 0.0
    for value, weight in zip(axis, weights, strict=True):
        margins = np.asarray(problem.limit_state(jnp.asarray(np.stack([np.full_like(axis, value), axis], axis=1))))
        total += weight * float(np.sum(weights * norm.cdf(-margins / NOISE)))
    return lambda z, noise: problem.limit_state(z) + NOISE * noise[:, 0], total


def summary(name: str, probability: float, found: Sequence[ProbabilityEstimate]) -> dict[str, Any]:
    """Figures of the estimates of one problem."""
    values = np.array([each.probability for each in found])
    inside = np.array([each.interval_95[0] <= probability <= each.interval_95[1] for each in found])
    trusted = np.array([each.trusted for each in found])
    listed = LISTED.get(name)
    return {
        "problem": name,
        "probability": probability,
        "mean_over_truth": float(values.mean() / probability) if probability > 0.0 else None,
        "standard_error": float(values.std(ddof=1) / values.mean() / len(found) ** 0.5) if values.any() else None,
        "variation_over_seeds": float(values.std(ddof=1) / values.mean()) if values.any() else None,
        "inside": int(inside.sum()),
        "inside_or_untrusted": int((inside | ~trusted).sum()),
        "untrusted": int((~trusted).sum()),
        "seeds": len(found),
        "evaluations": max(each.evaluations for each in found),
        "methods": sorted({each.method for each in found}),
        **({} if listed is None else {"inside_for_listed_value": _count_inside(found, listed)}),
    }


def _count_inside(found: Sequence[ProbabilityEstimate], value: float) -> int:
    return sum(each.interval_95[0] <= value <= each.interval_95[1] for each in found)


def main() -> None:
    """Prints one line of JSON for each problem, and the sums."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--budget", type=int, default=10_000)
    parser.add_argument("--method", default="auto")
    parser.add_argument("--set", choices=("public", "held-out", "unseen", "noise"), default="public", dest="group")
    parser.add_argument("--only", default="", help="Part of the name of a problem.")
    parser.add_argument("--out", type=Path, help="File to which the lines are added.")
    options = parser.parse_args()
    sets = {"held-out": known_problems.HELD_OUT, "unseen": known_problems.UNSEEN}
    problems = sets.get(options.group, known_problems.PUBLIC)
    method: MethodChoice = options.method
    lines = []
    for problem in problems:
        if options.only not in problem.name or (options.group == "noise" and problem.dimension != 2):
            continue
        limit_state, probability, noise = problem.limit_state, problem.probability, 0
        if options.group == "noise":
            limit_state, probability = noisy(problem)
            noise = 1
        found = [
            estimate_probability(
                limit_state, problem.dimension, budget=options.budget, seed=seed, method=method, noise_dimension=noise
            )
            for seed in range(options.first_seed, options.first_seed + options.seeds)
        ]
        lines.append(summary(problem.name, probability, found))
        print(json.dumps(lines[-1]), flush=True)
        if options.out:
            with options.out.open("a") as stream:
                stream.write(json.dumps(lines[-1]) + "\n")
    sums = {name: sum(line[name] for line in lines) for name in ("inside_or_untrusted", "untrusted", "seeds")}
    print(json.dumps(sums))


if __name__ == "__main__":
    main()
