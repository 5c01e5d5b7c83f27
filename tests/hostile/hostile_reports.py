"""Reports on campaigns with extreme numbers: the report is written, and says which section could not be worked out."""

import warnings
from pathlib import Path

import numpy as np
from case_ledger import Case
from hypothesis import strategies as st
from synthetic_campaign_results import synthetic_campaign

from rpojax.report.page.html_report import write_report

EXTREMES = (1e-200, 5e-324, 1e-300, 1e154, 1e155, 1e200, 1.7e308, -1.7e308, 0.0, -1e200, 1e-160)
GROUPS = ("metrics", "drawn", "traces", "histories")


def report_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Campaigns of synthetic numbers, some of which are extreme."""

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        group = draw(st.sampled_from(GROUPS))
        names = sorted(_arrays(folder, group))
        chosen = draw(st.lists(st.sampled_from(names), min_size=1, max_size=len(names), unique=True))
        damage = draw(st.sampled_from(("shift", "scale", "all extreme", "some extreme", "constant")))
        number, factor = draw(st.sampled_from(EXTREMES)), draw(st.sampled_from(EXTREMES))
        runs = draw(st.sampled_from((2, 12, 20)))
        label = f"{group}: {damage}"
        return Case("report", label, chosen[0], lambda: act(group, chosen, damage, (number, factor), runs))

    def act(group: str, names: list[str], damage: str, numbers: tuple[float, float], runs: int) -> None:
        campaign = synthetic_campaign(folder, runs=runs, seconds=120, kept=(0,))
        places = campaign.histories[0] if group == "histories" else getattr(campaign, group)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            for name in names:
                if name in places and places[name].dtype.kind == "f" and name != "time_s":
                    places[name] = _extreme(places[name], damage, *numbers)
            page = write_report(campaign, film=False, progress=False)
        assert page.stat().st_size > 10_000

    return build()


def _arrays(folder: Path, group: str) -> list[str]:
    campaign = synthetic_campaign(folder, runs=2, seconds=60, kept=(0,))
    return list(campaign.histories[0] if group == "histories" else getattr(campaign, group))


def _extreme(values: np.ndarray, damage: str, number: float, factor: float) -> np.ndarray:
    changed = np.asarray(values, np.float64).copy()
    match damage:
        case "shift":
            changed = changed + number
        case "scale":
            changed = changed * factor
        case "all extreme":
            changed = np.where(np.arange(changed.size).reshape(changed.shape) % 2 == 0, number, factor)
        case "some extreme":
            changed.reshape(-1)[::7] = number
        case _:
            changed[:] = number
    return np.where(np.isfinite(changed), changed, np.nan)
