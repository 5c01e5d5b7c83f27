"""The single table `[fault]` of scenarios before format 4, which is read as a list of one fault.

Random numbers and digests go by names, so that one of the former name has those of the table.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

NAME: Final = "fault"
"""Name of the fault that the table becomes."""
NOMINAL: Final = {"kind": "none", "start_s": 0.0, "duration_s": 1e9, "severity": 0.5, "wheel": 0}
"""Table of the packaged scenarios then."""
_FORMER, _PRESENT = f"{NAME}.", f"faults.{NAME}."


def former_name(name: str) -> str:
    """Name of a dispersion with its keys, which `+` joins, as they were."""
    return re.sub(rf"(^|\+){re.escape(_PRESENT)}", rf"\1{_FORMER}", name)


def present_key(key: Any) -> Any:
    """A former key as it is now; anything else is returned as it is."""
    return f"{_PRESENT}{key.removeprefix(_FORMER)}" if isinstance(key, str) and key.startswith(_FORMER) else key


def declared(scenario: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Tables of the faults of a recorded scenario, that of a former one included."""
    former = [{"name": NAME, **scenario["fault"]}] if "fault" in scenario else []
    return [dict(each) for each in scenario.get("faults", former)]


def with_present_keys(content: Any) -> Any:
    """Tables of a dispersion or a design with present keys."""
    return _renamed(content, present_key)


def as_formerly(content: Mapping[str, Any]) -> dict[str, Any]:
    """Content of a scenario in which a fault of the former name alone, or none at all, stands as it stood then."""
    faults = content["faults"]
    if [each["name"] for each in faults] not in ([], [NAME]):
        return dict(content)
    table = {name: value for name, value in faults[0].items() if name != "name"} if faults else dict(NOMINAL)
    if not table.get("thruster", 1.0):
        del table["thruster"]
    former = {**content, "fault": table}
    del former["faults"]
    for name in ("dispersions", "design"):
        if name in former:
            former[name] = _renamed(former[name], former_name)
    if "servicers" in former:
        former["servicers"] = [_servicer(each) for each in former["servicers"]]
    return former


def _servicer(table: Mapping[str, Any]) -> dict[str, Any]:
    rest = {name: value for name, value in table.items() if name != "faults"}
    return rest if not table.get("faults") else {**rest, "fault": table["faults"][NAME]}


def _renamed(content: Any, rename: Any) -> Any:
    """Content with each text, keys of tables included, renamed."""
    if isinstance(content, Mapping):
        return {rename(key): _renamed(value, rename) for key, value in content.items()}
    if isinstance(content, list):
        return [_renamed(each, rename) for each in content]
    return rename(content) if isinstance(content, str) else content
