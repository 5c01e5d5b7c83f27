"""Whether a reference has the gravity-gradient torque, which no parameter of its own gives away."""

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
    """True if the torque acts: as wished, by a key, by the description, or because the torque was logged."""
    possible = {"mu", "q", "I"} <= reference.arrays.keys() and bool({"r", "r_target"} & reference.arrays.keys())
    if override == "on" and not possible:
        raise FormatError(f"{reference.case}: gravity gradient: found no orbit and attitude, expected both")
    if override != "auto" or not possible:
        return override == "on"
    for told in (_stated_by_key(reference), _stated_by_text(reference)):
        if told is not None:
            return told
    return "torque_gg" in reference


def _stated_by_key(reference: Reference) -> bool | None:
    for key, value in (*reference.unknown.items(), *_nested_items(reference.meta)):
        match = _KEYS.fullmatch(_normalised_text(key))
        told = _parse_switch(value)
        if match and told is not None:
            return told != bool(match["no"])
    return None


def _nested_items(meta: dict[str, Any]) -> list[tuple[str, Any]]:
    """Keys and values of a description, also of objects inside it."""
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
    """What the description says, then its name; None if it says nothing, or both."""
    described = {key: value for key, value in reference.meta.items() if key not in ("case", "made_with")}
    texts = [f"{key}: {_text(value)}" for key, value in _nested_items(described)]
    for text in (texts, [str(reference.meta.get("case", ""))]):
        said = {acts for part in text for acts in torque_statements(part)}
        if said:
            return said.pop() if len(said) == 1 else None
    return None


def _text(value: Any) -> str:
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)


def _normalised_text(text: str) -> str:
    return re.sub(r"(?:[^\S\n]|[_-])+", " ", text.lower()).strip()


def torque_statements(text: str) -> list[bool]:
    """For each time that a text names the torque whether it says that the torque acts."""
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
    """By a negation in the clause, in the list that "or" ends, or one that opens a list: "not modelled: drag, ..."."""
    listed = re.search(r"\b(or|nor)\b", ahead) is not None
    opens_list = re.search(rf"\b({_NEGATIONS})\b[^,:]*:", before) is not None
    return opens_list or re.search(rf"\b({_NEGATIONS})\b", before + ahead if listed else ahead) is not None


def _is_negated_after(behind: str, after: str) -> bool:
    """By a negation a few words on in the clause, or by one that is all of the next clause."""
    return (
        re.search(rf"^(?:\W*\w+){{0,5}}?\W*\b({_NEGATIONS_AFTER})\b|^( torque)? free\b", behind) is not None
        or re.search(rf"^\W*(is |are )?(not (\w+ed|on)|{_WHOLE_CLAUSE_NEGATIONS})\W*$", after) is not None
    )
