"""What the scripts of this folder share: options, campaigns of cases or of a table of variants, Markdown rows.

Passive safety is not their subject: free drifts are propagated over an hour, and seldom.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import rpojax

if "jax" not in sys.modules:  # as where a test loads this file
    rpojax.prepare_process()

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.scenario.loading import scenario_loader

Tables = dict[str, Any]
Options = argparse.Namespace


def parser(doc: str | None, runs: int) -> argparse.ArgumentParser:
    """Parser of the options that all scripts have; `runs` is the default."""
    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--out", type=Path, required=True)
    made.add_argument("--runs", type=int, default=runs)
    made.add_argument("--seed", type=int, default=11)
    return made


@dataclass(frozen=True)
class Case:
    """A campaign: its name in the table, a packaged scenario, and overrides."""

    name: str
    scenario: str
    overrides: Sequence[str] = ()


def campaigns(cases: Sequence[Case], options: Options, histories: int = 0) -> Iterator[tuple[Case, Campaign]]:
    """Each case with its campaign; the histories of the first runs are kept. An existing campaign is resumed."""
    for case in cases:
        tables = rpojax.load(case.scenario, list(case.overrides)).model_dump(mode="json")
        yield case, campaign(tables, case.name, options.runs, range(min(histories, options.runs)), options)


def campaign(tables: Tables, name: str, runs: int, histories: Sequence[int], options: Options) -> Campaign:
    """Campaign of a scenario, in a folder of its own."""
    folder = options.out / "".join(letter if letter.isalnum() else "_" for letter in name)
    if (folder / "campaign.json").exists():
        return rpojax.resume_campaign(folder)
    tables["safety"] |= {"horizons": ["1_h"], "spacing_s": tables["duration_s"]}
    tables["requirements"] = [each for each in tables["requirements"] if "passive" not in each["metric"]]
    return rpojax.run_campaign(scenario_loader.validate(tables), runs, folder, options.seed, histories=list(histories))


@dataclass(frozen=True)
class Variant:
    """A mission: values in place of those of `inspection`, by key, for all runs, or as `(rng, runs)` draws them.

    Overrides change what is one value for a whole campaign: switches, rates, texts.
    """

    changes: Mapping[str, Any] = field(default_factory=dict)
    epoch_utc: str | None = None
    overrides: tuple[str, ...] = ()


def variant_campaigns(
    variants: Mapping[str, Variant], options: Options, histories: int
) -> Iterator[tuple[str, Campaign, slice]]:
    """Name of each variant, the campaign that holds it, and its runs there; one campaign for each epoch and overrides.

    The histories of the first runs of each variant are kept.
    """
    for epoch, overrides in dict.fromkeys((variant.epoch_utc, variant.overrides) for variant in variants.values()):
        here = {
            name: variant
            for name, variant in variants.items()
            if (variant.epoch_utc, variant.overrides) == (epoch, overrides)
        }
        first = np.arange(len(here)) * options.runs
        kept = (first[:, None] + np.arange(min(histories, options.runs))).ravel().tolist()
        tables = table_scenario(here, epoch, options.runs, options.seed)
        name = "_".join(("table", epoch or "packaged", *overrides))
        result = campaign(tables, name, len(here) * options.runs, kept, options)
        for place, name in enumerate(here):
            yield name, result, slice(place * options.runs, (place + 1) * options.runs)


def table_scenario(variants: Mapping[str, Variant], epoch_utc: str | None, runs: int, seed: int) -> Tables:
    """`inspection` with one row of a table for every run; keys that no variant changes stay as they are.

    A variant without a change of a key that another one changes has its nominal value, or one drawn as declared.
    """
    overrides = next(iter(variants.values())).overrides
    tables = rpojax.load("inspection", list(overrides)).model_dump(mode="json")
    tables["epoch_utc"] = epoch_utc or tables["epoch_utc"]
    keys = list(dict.fromkeys(key for variant in variants.values() for key in variant.changes))
    declared = {each["key"]: each for each in tables["dispersions"] if each["key"] in keys}
    tables["dispersions"] = [each for each in tables["dispersions"] if each["key"] not in keys]
    rng = np.random.default_rng(seed)
    columns: dict[str, list[float]] = {}
    for variant in variants.values():
        for key in keys:
            if callable(change := variant.changes.get(key)):
                values = change(rng, runs)
            elif key in variant.changes:
                values = np.repeat(np.asarray(change, dtype=float)[None], runs, axis=0)
            else:
                values = _drawn(rng, np.asarray(_value(tables, key), dtype=float), declared.get(key), runs)
            for index in np.ndindex(values.shape[1:]):
                name = key + "".join(f"[{place}]" for place in index)
                columns.setdefault(name, []).extend(values[(slice(None), *index)].tolist())
    tables["design"] = {"kind": "table", "values": columns}
    return tables


def _value(tables: Tables, key: str) -> Any:
    """Value of a key of a scenario."""
    found: Any = tables
    for part in key.split("."):
        found = found[part]
    return found


def _drawn(rng: np.random.Generator, nominal: np.ndarray, declared: Mapping[str, Any] | None, runs: int) -> np.ndarray:
    """Values of the runs: nominal, or dispersed as declared."""
    shape = (runs, *nominal.shape)
    if declared is None:
        return np.broadcast_to(nominal, shape)
    kinds: dict[str, Callable[[], np.ndarray]] = {
        "uniform": lambda: rng.uniform(declared["low"], declared["high"], shape),
        "normal": lambda: nominal + rng.normal(size=shape) * np.asarray(declared["sigma"]),
    }
    return kinds[declared["kind"]]()


def header(*titles: str) -> None:
    """Prints the head of a Markdown table."""
    row(*titles)
    print("|" + "---|" * len(titles), flush=True)


def row(*cells: str) -> None:
    """Prints a row of it."""
    print(f"| {' | '.join(cells)} |", flush=True)


def percent(fraction: float, digits: int = 1) -> str:
    """A fraction in percent; a dash where it is undefined."""
    return f"{100.0 * fraction:.{digits}f} %" if math.isfinite(fraction) else "-"


def mean(values: np.ndarray) -> float:
    """Mean of the values that are defined, NaN without any."""
    defined = values[np.isfinite(values)]
    return float(defined.mean()) if defined.size else math.nan


def outcome_counts(outcomes: np.ndarray) -> str:
    """Numbers of runs by outcome, such as `62 completed, 2 lost`."""
    kinds, counts = np.unique(outcomes, return_counts=True)
    return ", ".join(f"{count} {kind}" for kind, count in zip(kinds, counts, strict=True))
