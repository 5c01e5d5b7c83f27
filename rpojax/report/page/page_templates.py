"""Templates of all pages: their environment, filters, data for the scripts, and what every page ends with."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import jinja2
from markupsafe import Markup, escape

from rpojax.report.labels import format_number, format_p_value

_TERMS: Final = {
    "off station": "farther from its place than limits.off_station_m, after limits.arrive_by_s",
    "look-away": "the camera is turned away from the target, so that the thruster points where a burn must push",
    "the gate": "test by which the filter takes a box for one of the target or rejects it as a false one",
    "dead band": "velocity errors too small to burn for",
    "passively safe": "without any further burn the servicer stays outside of the keep-out sphere",
    "keep-out sphere": "sphere about the target that the servicer must never enter",
    "tolerance bound": "value that the demanded share of all possible runs keeps, wrong with at most the stated risk",
    "NEES": "squared error of the estimate over the variance that the filter believes; divided by the number of its "
    "components it is 1 in the mean where the filter is right",
    "filter diverged": "its error is far outside of what it believes of it",
    "lost the target": "no box was accepted for longer than limits.lost_after_s",
}
"""Terms of the first screen, and what they mean."""
_HASH_DIGITS: Final = 16
"""Digits of the scenario's hash at the foot of a page; the identity section has all."""


def render(template: str, data: Mapping[str, Any], values: Mapping[str, Any]) -> str:
    """Page from a template: its scripts read `data`, the template shows `values`."""
    found = _environment().get_template(template)
    return found.render(page_data=_script_json(data), **values)


def foot_text(info: Mapping[str, Any]) -> str:
    """Foot of every page: name, hash of the scenario, seed, version and date of a campaign, as far as recorded."""
    parts = [
        str(info.get("name", "campaign")),
        f"scenario {str(info['scenario_hash'])[:_HASH_DIGITS]}" if info.get("scenario_hash") else "",
        f"seed {info['seed']}" if "seed" in info else "",
        f"rpojax {info['versions']['rpojax']}" if "rpojax" in info.get("versions", {}) else "",
        str(info.get("created", "")).partition("T")[0],
    ]
    return " \N{MIDDLE DOT} ".join(part for part in parts if part)


def study_values(
    kind: str,
    contents: Mapping[str, str],
    study: Mapping[str, Any],
    sentences: Sequence[str],
    directory: Path,
    each: str,
) -> dict[str, Any]:
    """Values of `study.html` for a study of a scenario.

    Args:
        kind: of study, as the heading has it
        contents: headings of its sections by their names
        study: provenance in its record
        sentences: what it found, the headline first
        directory: that holds the page
        each: what so many runs are of, such as a step
    """
    return {
        "kind": kind,
        "contents": list(contents.items()),
        "name": study["scenario"],
        "headline": sentences[0],
        "sentences": sentences[1:],
        "identity": [
            ("Folder", str(directory)),
            ("Scenario", f"{study['scenario']}, hash {study['scenario_hash']}"),
            ("Seed", str(study["seed"])),
            ("Runs", f"{study['runs']} of each {each}, {study['runs_simulated']} in all"),
        ],
        "foot": foot_text({**study, "name": study["scenario"]}),
    }


def _environment() -> jinja2.Environment:
    here = Path(__file__).parent
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([here / "templates", here]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = format_number
    environment.filters["breakable"] = _with_break_opportunities
    environment.filters["p_value"] = format_p_value
    environment.filters["with_runs"] = _with_runs
    environment.filters["with_terms"] = _with_terms
    environment.filters["css_text"] = _css_text
    return environment


def _with_break_opportunities(text: str) -> Markup:
    """A name that may break into lines after its underscores and dots only."""
    return Markup(re.sub(r"([_.])", r"\1<wbr>", str(escape(text))))


def _with_runs(text: str) -> Markup:
    """A text in which the number after "run" is a button that marks the run in every chart."""
    button = r'run <button type="button" class="run" data-pick="\1">\1</button>'
    return Markup(re.sub(r"\brun (\d+)\b", button, str(escape(text))))


def _with_terms(text: str) -> Markup:
    """A text in which each term has its meaning as a tooltip."""
    pattern = "|".join(re.escape(term) for term in _TERMS)

    def explained(found: re.Match[str]) -> str:
        return f'<abbr title="{escape(_TERMS[found[0]])}">{found[0]}</abbr>'

    return Markup(re.sub(rf"\b(?:{pattern})\b", explained, str(escape(text))))


def _css_text(text: str) -> Markup:
    """Content of a CSS string: everything but plain characters escaped."""
    return Markup(re.sub(r"[^A-Za-z0-9 .,:;_+-]", lambda found: f"\\{ord(found[0]):06x}", text))


def _script_json(value: Any) -> Markup:
    """JSON, escaped so that it cannot end the script element around it."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))
