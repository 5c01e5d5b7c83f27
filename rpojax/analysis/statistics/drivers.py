"""Drivers of an event such as a violated requirement: inputs and pairs of inputs that go with it, few of them falsely.

An input is tested by its rank, its distance from the middle, and the share of events in its tails or at its values
(exact, hypergeometric). A pair is tested beyond its single effects: causes that act independently multiply the
probabilities to be spared, so the null hypothesis is that ln(1 - p) is a sum of functions of single inputs. The test is
the score of products of both inputs, made orthogonal to functions of either of them (Rao, 1948).

The expected share of false ones among all that are reported, over all events and apart for singles and pairs, is
bounded as by Benjamini and Hochberg (J. R. Statist. Soc. B 57, 1995). Pairs of two inputs that are reported themselves,
and pairs with one, share a third of the weight of all pairs each (Genovese, Roeder and Wasserman, Biometrika 93, 2006):
most effects of pairs show in their inputs, too.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy.stats import hypergeom, norm

LEVEL: Final = 0.02
"""Bound of the expected share of false drivers among those that are reported."""
MIN_EVENTS: Final = 5
"""An event that fewer runs have, or lack, has no drivers."""
_FEW_VALUES: Final = 8
"""An input with at most so many values is tested value by value."""
_MOST_PAIRED: Final = 40
"""Inputs of an event, those of the smallest p-value, of which pairs are tested."""
_LEAST_SHARE: Final = 0.1
"""Share of runs that a value must have to be paired."""
_PROMISING: Final = 0.01
"""P-value of single inputs below which they are in the model that pairs are tested beyond."""
_LEAST_RATE: Final = 0.25
"""Least rate of a model of single effects, over the mean: no run is free of other causes."""
_PRIOR: Final = 0.1
_ITERATIONS: Final = 30
_SHOWN_PARTS: Final = 3


@dataclass(frozen=True)
class Driver:
    """One or two inputs that go with an event.

    Attributes:
        event: name of the event
        inputs: one or two names
        p_value: of the input, or of the pair beyond its single effects, corrected for the features tested
        q_value: smallest bound on false drivers at which it is reported
        parts: for each input, the edges of three parts with equal numbers of runs, or its values if they are few
        runs: in each part (k,), or pair of parts (k, m)
        events: of them
    """

    event: str
    inputs: tuple[str, ...]
    p_value: float
    q_value: float
    parts: tuple[tuple[float, ...], ...]
    runs: np.ndarray
    events: np.ndarray


@dataclass(frozen=True)
class _Input:
    """Features of an input over the runs of an event.

    Attributes:
        values: (runs,)
        is_discrete: whether its values are few
        is_categorical: whether they have no order
        shares: (runs, k) flags of the parts that are tested exactly
        scores: (runs, m) that are tested by their mean
        paired: (runs, j) centred features for products with another input
    """

    values: np.ndarray
    is_discrete: bool
    is_categorical: bool
    shares: np.ndarray
    scores: np.ndarray
    paired: np.ndarray

    @property
    def effects(self) -> np.ndarray:
        """Features (runs, i) whose single effects pairs are tested beyond."""
        return np.concatenate([self.scores, self.shares[:, 1:], self.paired], axis=1)


@dataclass(frozen=True)
class _Candidate:
    event: str
    inputs: tuple[str, ...]
    p_value: float
    weight: float = 1.0


def drivers(
    inputs: Mapping[str, np.ndarray],
    events: Mapping[str, np.ndarray],
    categorical: Collection[str] = (),
    level: float = LEVEL,
) -> list[Driver]:
    """Inputs and pairs of inputs that go with events, of each event those of the smallest p-value first.

    Args:
        inputs: name -> (runs,) finite values
        events: name -> (runs,) 1 or true where a run has the event, 0 where not, NaN where it does not count
        categorical: names of inputs whose values have no order
        level: bound of the expected share of false ones among all that are reported
    """
    tested = {
        name: (found, np.asarray(flags, np.float64)[found] > 0.5)
        for name, flags in events.items()
        if _is_testable(np.asarray(flags, np.float64)[found := np.isfinite(np.asarray(flags, np.float64))])
    }
    described = {name: _described(inputs, counted, set(categorical)) for name, (counted, _) in tested.items()}
    singles = [
        _Candidate(event, (name,), _single_p(one, tested[event][1]))
        for event, features in described.items()
        for name, one in features.items()
    ]
    single_q = _q_values(singles)
    leading = {(one.event, one.inputs[0]) for one, q in zip(singles, single_q, strict=True) if q <= level}
    by_event = {event: [one for one in singles if one.event == event] for event in described}
    pairs = [
        pair
        for event, features in described.items()
        for pair in _pairs(event, features, tested[event][1], by_event[event])
    ]
    pairs = _weighted(pairs, leading)
    reported = [
        (one, float(q))
        for family in ((singles, single_q), (pairs, _q_values(pairs)))
        for one, q in zip(*family, strict=True)
        if q <= level
    ]
    order = {event: place for place, event in enumerate(events)}
    reported.sort(key=lambda each: (order[each[0].event], each[0].p_value))
    return [_driver(one, q, described[one.event], tested[one.event][1]) for one, q in reported]


def _is_testable(flags: np.ndarray) -> bool:
    count = int(np.sum(flags > 0.5))
    return MIN_EVENTS <= count <= len(flags) - MIN_EVENTS


def _described(
    inputs: Mapping[str, np.ndarray], counted: np.ndarray, categorical: Collection[str]
) -> dict[str, _Input]:
    """Features of the inputs that vary over the runs that count."""
    columns = {name: np.asarray(values, np.float64)[counted] for name, values in inputs.items()}
    kept = {name: values for name, values in columns.items() if np.isfinite(values).all() and np.ptp(values) > 0.0}
    return {name: _features(values, name in categorical) for name, values in kept.items()}


def _features(values: np.ndarray, is_categorical: bool) -> _Input:
    distinct, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    # Mid-ranks in the open unit interval: equal values are equal.
    rank = ((np.cumsum(counts) - 0.5 * counts) / len(values))[places]
    ordered = np.zeros((len(values), 0)) if is_categorical else np.stack([rank - 0.5, np.abs(rank - 0.5)], axis=1)
    is_discrete = is_categorical or len(distinct) <= _FEW_VALUES
    tails = np.stack([rank < 0.1, rank < 0.25, rank >= 0.75, rank >= 0.9], axis=1)
    shares = values[:, None] == distinct if is_discrete else tails
    if is_categorical:
        common = shares[:, counts >= _LEAST_SHARE * len(values)][:, 1 if len(distinct) == 2 else 0 :]
        return _Input(values, True, True, shares, ordered, common - common.mean(axis=0))
    paired = np.stack([np.where(rank < 0.5, -1.0, 1.0), rank - 0.5], axis=1)
    return _Input(values, is_discrete, False, shares, ordered, paired)


def _single_p(one: _Input, event: np.ndarray) -> float:
    """P-value of an input, Bonferroni over its features."""
    runs, count = len(event), int(event.sum())
    sizes, hits = one.shares.sum(axis=0), one.shares[event].sum(axis=0)
    above = hypergeom.sf(hits - 1, runs, sizes, count)
    below = hypergeom.cdf(hits, runs, sizes, count)
    found = [2.0 * np.minimum(above, below)]
    if one.scores.shape[1]:
        spread = one.scores.std(axis=0, ddof=1)
        error = np.where(spread > 0.0, spread, 1.0) * np.sqrt((runs - count) / (runs * count))
        found.append(2.0 * norm.sf(np.abs(one.scores[event].mean(axis=0) - one.scores.mean(axis=0)) / error))
    p_values = np.concatenate(found)
    return float(min(1.0, len(p_values) * p_values.min()))


def _pairs(
    event_name: str, features: Mapping[str, _Input], event: np.ndarray, singles: list[_Candidate]
) -> list[_Candidate]:
    """Pairs of the most promising inputs, with their p-values beyond single effects."""
    ranked = sorted(singles, key=lambda one: one.p_value)
    chosen = [one.inputs[0] for one in ranked[:_MOST_PAIRED]]
    promising = [one.inputs[0] for one in ranked if one.p_value < _PROMISING]
    base = np.concatenate([np.ones((len(event), 1)), *(features[name].effects for name in promising)], axis=1)
    base = base[:, _independent(base)]
    rate = _rate_of_independent_causes(base, event)
    # In the metric of the weights, in which the model's columns are taken out once for all pairs.
    root, residual = np.sqrt((1.0 - rate) / rate), (event - rate) / np.sqrt(rate * (1.0 - rate))
    span = np.linalg.qr(base * root[:, None])[0]

    def free_of_model(columns: np.ndarray) -> np.ndarray:
        scaled = columns * root[:, None]
        return scaled - span @ (span.T @ scaled)

    effects = {name: free_of_model(features[name].effects) for name in chosen}
    found = []
    for first, second in combinations(sorted(chosen), 2):
        products = free_of_model(_products(features[first], features[second]))
        p_value = _score_p(products, np.concatenate([effects[first], effects[second]], axis=1), residual)
        found.append(_Candidate(event_name, (first, second), p_value))
    return found


def _products(first: _Input, second: _Input) -> np.ndarray:
    """Products (runs, k) of the paired features of two inputs; of two with an order those of halves and of ranks."""
    if first.is_categorical or second.is_categorical:
        return (first.paired[:, :, None] * second.paired[:, None, :]).reshape(len(first.values), -1)
    return first.paired * second.paired


def _score_p(products: np.ndarray, effects: np.ndarray, residual: np.ndarray) -> float:
    """P-value of products (runs, k) beyond effects (runs, m) by their scores, Bonferroni over the products."""
    shared = effects.T @ products
    # Effects may depend on each other: the inverse is that of what they span.
    slopes = np.linalg.pinv(effects.T @ effects, rcond=1e-9, hermitian=True) @ shared
    before = np.sum(np.square(products), axis=0)
    left = before - np.sum(shared * slopes, axis=0)
    kept = left > 1e-6 * before.max(initial=1e-300)
    if not kept.any():
        return 1.0
    scores = np.abs(products.T @ residual - slopes.T @ (effects.T @ residual))[kept] / np.sqrt(left[kept])
    return float(min(1.0, kept.sum() * 2.0 * norm.sf(scores.max())))


def _independent(columns: np.ndarray) -> np.ndarray:
    """Flags of columns that are not combinations of those before them."""
    kept: list[np.ndarray] = []
    flags = np.zeros(columns.shape[1], bool)
    for place, column in enumerate(columns.T):
        left = column.copy()
        for known in kept:
            left = left - known * (known @ left)
        length = float(np.linalg.norm(left))
        if length > 1e-6 * float(np.linalg.norm(column)) and length > 0.0:
            kept.append(left / length)
            flags[place] = True
    return flags


def _rate_of_independent_causes(columns: np.ndarray, event: np.ndarray) -> np.ndarray:
    """Probabilities (runs,) of an event by a model in which -ln(1 - p) is a sum, by iterated weighted least squares."""
    mean = -np.log1p(-float(event.mean()))
    low, high = _LEAST_RATE * mean, 3.0 + mean
    total = np.full(len(event), mean)
    for _ in range(_ITERATIONS):
        spared = np.exp(-total)
        weights = spared / (1.0 - spared)
        target = total + (event - (1.0 - spared)) / spared
        weighted = columns * weights[:, None]
        prior = _PRIOR * float(weights.mean()) * np.eye(columns.shape[1])
        found = np.clip(columns @ np.linalg.solve(weighted.T @ columns + prior, weighted.T @ target), low, high)
        if float(np.abs(found - total).max()) < 1e-6 * mean:
            break
        total = found
    return 1.0 - np.exp(-total)


def _weighted(pairs: list[_Candidate], leading: Collection[tuple[str, str]]) -> list[_Candidate]:
    """Pairs with weights of mean one: a third for all, one for pairs of two leading inputs, one for those with one."""
    counts = [sum((pair.event, name) in leading for name in pair.inputs) for pair in pairs]
    groups = [group for group in (1, 2) if group in counts]
    share = len(pairs) / (1 + len(groups))
    return [
        replace(pair, weight=share / len(pairs) + (share / counts.count(count) if count else 0.0))
        for pair, count in zip(pairs, counts, strict=True)
    ]


def _q_values(candidates: list[_Candidate]) -> np.ndarray:
    """Smallest level at which each is reported (Benjamini and Hochberg, with weights)."""
    scaled = np.array([one.p_value / one.weight for one in candidates])
    order = np.argsort(scaled)
    steps = scaled[order] * len(scaled) / np.arange(1, len(scaled) + 1)
    found = np.empty(len(scaled))
    found[order] = np.minimum(np.minimum.accumulate(steps[::-1])[::-1], 1.0)
    return found


def _driver(one: _Candidate, q: float, features: Mapping[str, _Input], event: np.ndarray) -> Driver:
    """A reported driver with the runs and events of the parts of its inputs."""
    parts, places = zip(*(_parts(features[name]) for name in one.inputs), strict=True)
    sizes = tuple(int(place.max()) + 1 for place in places)
    flat = np.ravel_multi_index(places, sizes)
    total = int(np.prod(sizes))
    runs = np.bincount(flat, minlength=total).reshape(sizes)
    events = np.bincount(flat, weights=event, minlength=total).astype(int).reshape(sizes)
    return Driver(one.event, one.inputs, one.p_value, q, parts, runs, events)


def _parts(one: _Input) -> tuple[tuple[float, ...], np.ndarray]:
    """Edges of parts, or values where they are few, and the part of each run."""
    if one.is_discrete:
        distinct, places = np.unique(one.values, return_inverse=True)
        return tuple(distinct.tolist()), places
    edges = np.quantile(one.values, np.linspace(0.0, 1.0, _SHOWN_PARTS + 1))
    return tuple(edges.tolist()), np.clip(np.searchsorted(edges, one.values, side="right") - 1, 0, _SHOWN_PARTS - 1)
