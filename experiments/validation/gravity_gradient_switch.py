"""Whether a reference includes the gravity-gradient torque, for which the format has no parameter."""

import re
from typing import Any

import numpy as np

from experiments.validation.reference_file import FormatError, Reference

_KEYS = re.compile(
    r"(?P<no>no |without |disable )?(use |with |include |enable |has )?(gravity gradient|gg)( torque)?( on)?"
)
_TORQUE_NAME = r"gravity gradient|gravitational gradient|\bgg\b|3(\.0)? ?\*? ?mu ?/"
_NEGATIONS = (
    r"no|not|without|free of|free from|off|excludes?|excluding|excluded|neglect\w*|ignor\w*|omit\w*|disabled?|false"
)
_NEGATIONS_AFTER = rf"{_NEGATIONS}|none|absent|zero"
_WHOLE_CLAUSE_NEGATIONS = r"off|none|false|disabled|excluded|neglected|ignored|omitted"
_DOUBLE_NEGATION = r"\bnot (only|just|negligible|neglected|ignored|omitted|disabled|excluded|off)\b"
_ON = ("on", "true", "yes", "1", "enabled", "included")
_OFF = ("off", "false", "no", "0", "none", "disabled", "excluded")


def has_gravity_gradient(reference: Reference, override: str = "auto") -> bool:
    """Whether the torque acts: by the override, a key, the description, or because it was logged.

    Raises:
        FormatError: the override is "on" for a reference without orbit or attitude.
    """
    possible = {"mu", "q", "I"} <= reference.arrays.keys() and bool({"r", "r_target"} & reference.arrays.keys())
    if override == "on" and not possible:
        raise FormatError(f"{reference.case}: gravity gradient: found no orbit and attitude, expected both")
    if override != "auto" or not possible:
        return override == "on"
    for stated in (_stated_by_key(reference), _stated_by_text(reference)):
        if stated is not None:
            return stated
    return "torque_gg" in reference


def _stated_by_key(reference: Reference) -> bool | None:
    for key, value in (*reference.unknown.items(), *_nested_items(reference.meta)):
        match = _KEYS.fullmatch(_normalised_text(key))
        stated = _parse_switch(value)
        if match and stated is not None:
            return stated != bool(match["no"])
    return None


def _nested_items(meta: dict[str, Any]) -> list[tuple[str, Any]]:
    """Keys and values of a description, including those of nested objects."""
    inner = [pair for value in meta.values() if isinstance(value, dict) for pair in _nested_items(value)]
    return [*((key, value) for key, value in meta.items() if not isinstance(value, dict)), *inner]


def _parse_switch(value: Any) -> bool | None:
    if isinstance(value, np.ndarray):
        value = value.item() if value.size == 1 else None
    if isinstance(value, bool | int | float):
        return bool(value)
    word = str(value).strip().lower()
    return True if word in _ON else False if word in _OFF else None


def _stated_by_text(reference: Reference) -> bool | None:
    """Statement of the description, else of the name of the case; None if absent or contradictory."""
    described = {key: value for key, value in reference.meta.items() if key not in ("case", "made_with")}
    texts = [f"{key}: {_text(value)}" for key, value in _nested_items(described)]
    for text in (texts, [str(reference.meta.get("case", ""))]):
        statements = {acts for part in text for acts in torque_statements(part)}
        if statements:
            return statements.pop() if len(statements) == 1 else None
    return None


def _text(value: Any) -> str:
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)


def _normalised_text(text: str) -> str:
    return re.sub(r"(?:[^\S\n]|[_-])+", " ", text.lower()).strip()


def torque_statements(text: str) -> list[bool]:
    """Whether the torque acts, for each mention of it in a text."""
    found = []
    for sentence in re.split(r"[;\n]|\.(?=\s|$)|\bbut\b", re.sub(_DOUBLE_NEGATION, "", _normalised_text(text))):
        clauses = re.split(r"[,()]|\+|&", sentence)
        for place, clause in enumerate(clauses):
            before, after = ",".join([*clauses[:place], ""]), "".join(clauses[place + 1 : place + 2])
            for name in re.finditer(_TORQUE_NAME, clause):
                ahead, behind = clause[: name.start()], clause[name.end() :]
                found.append(not (_is_negated_before(before, ahead) or _is_negated_after(behind, after)))
    return found


def _is_negated_before(before: str, ahead: str) -> bool:
    """Negated in the clause, in a list that ends with "or", or by the head of a list: "not modelled: drag, ..."."""
    listed = re.search(r"\b(or|nor)\b", ahead) is not None
    opens_list = re.search(rf"\b({_NEGATIONS})\b[^,:]*:", before) is not None
    return opens_list or re.search(rf"\b({_NEGATIONS})\b", before + ahead if listed else ahead) is not None


def _is_negated_after(behind: str, after: str) -> bool:
    """Negated within the next words of the clause, or by a next clause that is only a negation."""
    return (
        re.search(rf"^(?:\W*\w+){{0,5}}?\W*\b({_NEGATIONS_AFTER})\b|^( torque)? free\b", behind) is not None
        or re.search(rf"^\W*(is |are )?(not (\w+ed|on)|{_WHOLE_CLAUSE_NEGATIONS})\W*$", after) is not None
    )
