"""Planted effects among thirty inputs: how many drivers are found, and how many are false, over ten seeds.

    python experiments/evidence/planted_drivers.py

Twenty failure modes of one campaign of 1000 runs, each with a planted effect of its own: ten modes fail in 20 % of runs
in the upper half of an input and else in 5 %, ten in 30 % of runs in the upper halves of both inputs of a pair and else
in 5 %. A driver is false if it is neither planted nor one input of a planted pair, which the failures of its mode
depend on, too. Last, twenty separate data sets of one mode each.
"""

import json

import numpy as np

from rpojax.analysis.statistics.drivers import drivers

RUNS, INPUTS, MODES, SEEDS = 1000, 30, 20, 10
Effects = dict[str, tuple[str, ...]]


def planted(seed: int) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], Effects]:
    """Inputs of several kinds, flags of failure by mode, and the planted inputs of each mode."""
    rng = np.random.default_rng(seed)
    kinds = (rng.normal, rng.uniform, lambda size: rng.integers(0, 4, size).astype(float))
    inputs = {f"x{number}": kinds[number % 3](size=RUNS) for number in range(INPUTS)}
    # The upper half of the runs; of an input of four values the upper two.
    middle = {name: 1.5 if number % 3 == 2 else np.median(inputs[name]) for number, name in enumerate(inputs)}
    upper = {name: values > middle[name] for name, values in inputs.items()}
    events, effects = {}, {}
    for mode in range(MODES):
        names = tuple(sorted(rng.choice(list(inputs), 1 + mode % 2, replace=False).tolist()))
        hit = np.all([upper[name] for name in names], axis=0)
        rate = np.where(hit, 0.2 if len(names) == 1 else 0.3, 0.05)
        effects[f"mode {mode}"] = names
        events[f"mode {mode}"] = rng.random(RUNS) < rate
    return inputs, events, effects


def scored(inputs: dict[str, np.ndarray], events: dict[str, np.ndarray], effects: Effects) -> tuple[int, int, int]:
    """Numbers of planted effects found, of false drivers, and of all reported."""
    reported = drivers(inputs, events)
    found = {one.event for one in reported if one.inputs == effects[one.event]}
    false = sum(not set(one.inputs) <= set(effects[one.event]) for one in reported)
    return len(found), false, len(reported)


def main() -> None:
    """Prints a line for each seed, and the means of both readings and of data sets without an effect."""
    joint, apart, nothing = [], [], []
    for seed in range(SEEDS):
        inputs, events, effects = planted(seed)
        joint.append(scored(inputs, events, effects))
        each = []
        for mode in range(MODES):
            # A data set of its own: other runs, one mode.
            own_inputs, own_events, own_effects = planted(1000 + MODES * seed + mode)
            name = f"mode {mode}"
            each.append(scored(own_inputs, {name: own_events[name]}, own_effects))
        apart.append(tuple(np.sum(each, axis=0).tolist()))
        rng = np.random.default_rng(5000 + seed)
        chance = {name: rng.random(RUNS) < 0.05 for name in events}
        nothing.append(len(drivers(inputs, chance)))
        print(json.dumps({"seed": seed, "one campaign": joint[-1], "separate": apart[-1], "by chance": nothing[-1]}))
    for name, counts in (("one campaign", joint), ("separate data sets", apart)):
        found, false, reported = np.mean(counts, axis=0).tolist()
        print(
            json.dumps(
                {name: {"found_of_20": found, "least": min(c[0] for c in counts), "false": false, "reported": reported}}
            )
        )
    print(json.dumps({"reported without an effect, of 20 modes": float(np.mean(nothing))}))


if __name__ == "__main__":
    main()
