"""Scenario files: found, merged, overridden, checked; then the static settings that a compiled loop is built for."""

import difflib
import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from pydantic import ValidationError

from rpojax.errors import ScenarioError, UnknownKeyError
from rpojax.physics.plant_options import Effects
from rpojax.scenario import case_table_csv, trained_files
from rpojax.scenario.consistency_checks import check_consistency
from rpojax.scenario.field_types import epoch_seconds
from rpojax.scenario.schema import ScenarioFile

if TYPE_CHECKING:
    from rpojax.vision.radiance_field.ray_budget import RaySampling


@dataclass(frozen=True)
class Scenario:
    """Static settings; changing one means compiling anew.

    Attributes:
        ticks: camera ticks of a run
        tick_s: camera, filter and guidance period [s]
        substeps: plant and attitude control steps per tick
        formation_ticks: ticks between burn decisions
        width_px: of the image
        height_px: of the image
        camera_model: where boxes come from
        gated: boxes pass the covariance gate
        navigation_zonal_degree: of the gravity that the orbit filter knows
        navigation_luni_solar: the orbit filter knows the pull of the Sun and the Moon
        epoch_s: start of a run, after 2000-01-01 12:00 terrestrial time [s]
        effects: what the plant takes into account
        rays: of a rendered picture, else None
    """

    ticks: int
    tick_s: float
    substeps: int
    formation_ticks: int
    width_px: int
    height_px: int
    camera_model: str
    box_gating: bool
    navigation_zonal_degree: int
    navigation_luni_solar: bool
    epoch_s: float
    effects: Effects
    ray_sampling: "RaySampling | None"

    @property
    def step_s(self) -> float:
        """Plant step [s]."""
        return self.tick_s / self.substeps

    @property
    def formation_period_s(self) -> float:
        """Time between burn decisions [s]."""
        return self.tick_s * self.formation_ticks


def packaged_names() -> list[str]:
    """Names of the scenarios that come with the package."""
    folder = resources.files("rpojax.scenario") / "packaged"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load(source: str | Path, overrides: Sequence[str] = ()) -> ScenarioFile:
    """Scenario from a packaged name or a TOML file, with `KEY=VALUE` overrides, checked.

    A file may say `extends = NAME_OR_PATH` and then needs only the keys that differ; its dispersions join the others.
    The table of a design is read here, and its values are part of the scenario from then on.

    Raises:
        ScenarioError: the source is unknown or a key is not acceptable.
    """
    tables = _read_tables(source)
    for override in overrides:
        _apply_override(tables, override)
    _load_case_table(tables)
    return validate(tables)


def validate(tables: Mapping[str, Any]) -> ScenarioFile:
    """Scenario from nested tables in the user's units, checked.

    Raises:
        ScenarioError: naming the key's path, what was found and what was expected.
    """
    try:
        file = ScenarioFile.model_validate(tables)
    except ValidationError as error:
        raise _first_error(error) from None
    check_consistency(file)
    return file


def static_settings(file: ScenarioFile, allow_single: bool = False) -> Scenario:
    """Static settings of a checked scenario; `single` says that the caller flies it in single precision if it asks so.

    Raises:
        ScenarioError: the scenario asks for single precision and the caller has none.
    """
    if file.precision == "single" and not allow_single:
        raise ScenarioError("precision", file.precision, "'double', as only run, campaign and bench know 'single'")
    rates = file.rates
    return Scenario(
        ticks=round(file.duration_s * rates.camera_hz),
        tick_s=1.0 / rates.camera_hz,
        substeps=round(rates.plant_hz / rates.camera_hz),
        formation_ticks=round(rates.formation_period_s * rates.camera_hz),
        width_px=file.camera.width_px,
        height_px=file.camera.height_px,
        camera_model=file.camera.model,
        box_gating=file.navigation.gating == "covariance",
        navigation_zonal_degree=file.navigation.zonal_degree,
        navigation_luni_solar=file.navigation.luni_solar,
        epoch_s=epoch_seconds(file.epoch_utc),
        effects=Effects(**file.effects.model_dump()),
        ray_sampling=trained_files.sampling_for_model(file.model_dump()),
    )


def digest(file: ScenarioFile) -> str:
    """Hash of everything in a scenario that can change a number of a run.

    Name, description, requirements and what tuning strives for cannot.
    """
    content = file.model_dump(mode="json", exclude={"name", "description", "requirements", "tuning"})
    if file.design.kind == "independent":
        del content["design"]
    elif file.design.kind == "grid":
        # The order of a grid's keys says which run has which combination.
        content["design"]["values"] = list(content["design"]["values"].items())
    if file.precision == "double":
        # As before there was another: campaigns of then go on.
        del content["precision"]
    if trained := trained_files.required_digests(content):
        content["trained"] = trained
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _read_tables(source: str | Path, depth: int = 0) -> dict[str, Any]:
    if depth > 8:
        raise ScenarioError("extends", str(source), "a chain of scenarios that ends")
    text, folder = _read_text(source)
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(str(source), str(error), "a valid TOML file") from None
    _resolve_paths(tables, folder)
    base = tables.pop("extends", None)
    if base is None:
        return tables
    if not isinstance(base, str):
        raise ScenarioError("extends", base, "the name of a packaged scenario or the path of a TOML file")
    return _merge(_read_tables(base if base in packaged_names() else folder / base, depth + 1), tables)


def _resolve_paths(tables: dict[str, Any], folder: Path) -> None:
    """Paths of trained files and tables start from the scenario's folder."""
    imaging = tables.get("imaging")
    for key in trained_files.PACKAGED_FILES:
        name = imaging.get(key) if isinstance(imaging, dict) else None
        if isinstance(name, str) and name != trained_files.PACKAGED and isinstance(imaging, dict):
            imaging[key] = str((folder / name).resolve())
    design = tables.get("design")
    if isinstance(design, dict) and isinstance(design.get("file"), str) and design["file"]:
        design["file"] = str(folder.absolute() / design["file"])


def _load_case_table(tables: dict[str, Any]) -> None:
    """Puts the values of a design's table in place of its file, so that the scenario holds all that a run needs."""
    design = tables.get("design")
    if not isinstance(design, dict) or design.get("kind") != "table" or not isinstance(design.get("file"), str):
        return
    if design["file"] and design.get("values"):
        raise ScenarioError("design.file", design["file"], "no file beside values")
    if design["file"]:
        tables["design"] = {**design, "file": "", "values": case_table_csv.read_columns(Path(design["file"]))}


def _read_text(source: str | Path) -> tuple[str, Path]:
    """Text of a scenario and the folder that relative paths in it start from."""
    if str(source) in packaged_names():
        return (resources.files("rpojax.scenario") / "packaged" / f"{source}.toml").read_text(), Path()
    path = Path(source)
    try:
        # With or without the mark that some Windows editors put first.
        return path.read_text(encoding="utf-8-sig"), path.parent
    except (OSError, UnicodeDecodeError):
        expected = f"a packaged scenario ({', '.join(packaged_names())}) or a readable TOML file"
        raise ScenarioError("scenario", str(source), expected) from None


def _merge(base: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        if key == "dispersions" and isinstance(old, list) and isinstance(value, list):
            merged[key] = _merge_dispersions(old, value)
            continue
        if key == "design":
            merged[key] = value
            continue
        merged[key] = _merge(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return merged


def _merge_dispersions(base: list[Any], changes: list[Any]) -> list[Any]:
    """The base's dispersions, those of the same key, or keys, replaced, the others added."""

    def name(entry: Any) -> Any:
        return (entry.get("key"), entry.get("keys")) if isinstance(entry, dict) else None

    changed = [name(entry) for entry in changes]
    return [entry for entry in base if name(entry) not in changed] + changes


def _apply_override(tables: dict[str, Any], override: str) -> None:
    """Applies one `KEY=VALUE`; the value is read as TOML, a bare word counts as text."""
    key, equals, text = override.partition("=")
    key, text = key.strip(), text.strip()
    if not equals or not key or not text:
        raise ScenarioError("--set", override, "KEY=VALUE, such as navigation.gate_sigma=4")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *path, leaf = key.split(".")
    node: Any = tables
    for name in path:
        node = node.get(name) if isinstance(node, dict) else None
    if not isinstance(node, dict) or leaf not in node:
        raise ScenarioError("--set", key, f"a key of the scenario{_suggestion(node, leaf)}")
    node[leaf] = value


def _suggestion(node: Any, leaf: str) -> str:
    close = difflib.get_close_matches(leaf, list(node), n=1) if isinstance(node, dict) else []
    return f" (did you mean {close[0]!r}?)" if close else ""


def _first_error(error: ValidationError) -> ScenarioError:
    """One line about the first fault that pydantic found."""
    faults = error.errors()
    first = _key_path(faults[0]["loc"])
    # Where a value may be a number or a list, pydantic reports both; the fault that goes deepest is the apt one.
    related = [fault for fault in faults if _key_path(fault["loc"])[: len(first)] == first]
    fault = max(related, key=lambda fault: len(_key_path(fault["loc"])))
    key = ".".join(_key_path(fault["loc"]))
    if fault["type"] == "extra_forbidden":
        return UnknownKeyError(key, _similar_key(fault["loc"]))
    if fault["type"] == "missing":
        return ScenarioError(key, "nothing", "a value for this key")
    if fault["type"] in ("model_type", "model_attributes_type"):
        return ScenarioError(key, fault["input"], "a table")
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Input should be ").removeprefix("expected ")
    return ScenarioError(key, fault["input"], message)


def _key_path(location: tuple[int | str, ...]) -> list[str]:
    """Key's path as a user wrote it: without the names that pydantic gives to the branches of a union."""
    branch = {"dispersions": 2, "design": 1}.get(str(location[0])) if location else None
    parts = [part for index, part in enumerate(location) if index != branch]
    return [str(part) for part in parts if not str(part).startswith(("constrained-", "list["))]


def _similar_key(location: tuple[int | str, ...]) -> str:
    fields, unknown = ScenarioFile.model_fields, str(location[-1])
    if len(location) > 1 and location[0] in fields:
        form = fields[str(location[0])].annotation
        section = next(iter(get_args(form)), form)
        names = list(getattr(section, "model_fields", {}))
    else:
        names = list(fields)
    close = difflib.get_close_matches(unknown, names, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""
