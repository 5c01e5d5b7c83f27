"""Folder of an estimate: what was asked, the margins of every batch of runs, and the result.

An estimate is a function of scenario, options and seed. A resumed one goes through the same steps again and reads the
margins of finished batches from the folder, so its result is the same to the last bit. Every file is written whole and
carries a digest of its content; files of margins also carry a digest of their points.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args, get_type_hints

import numpy as np
from pydantic import BaseModel, FiniteFloat, ValidationError

from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints, LimitFunction
from rpojax.analysis.reliability.search_settings import EstimateSettings, FailureChoice
from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.errors import OutputError, ResultError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.untrusted.file_reading import FileKind

CONFIGURATION_NAME, RESULT_NAME, BATCHES_NAME = "estimate.json", "probability.json", "evaluations"
_MOST_POINTS = 4096
"""Most points in one file."""
_TYPES: dict[str, type] = {"scenario": dict, "failure": dict, "budget": int, "method": str, "seed": int}
_METHODS = get_args(get_type_hints(EstimateSettings)["method"])


class EstimateFolder:
    """Folder of an estimate.

    Attributes:
        directory: its path
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._calls = 0

    @property
    def is_begun(self) -> bool:
        """Whether the folder holds an estimate, finished or not."""
        return (self.directory / CONFIGURATION_NAME).exists()

    def begin(self, configuration: dict[str, Any], force: bool) -> None:
        """Creates the folder, or checks that an existing one holds the same estimate.

        Raises:
            OutputError: it holds other files, or another estimate and `force` is false.
            ResultError: its configuration is no longer what was written, or it was begun with other versions of the
                packages.
            UnfinishedError: it cannot be made.
        """
        if self.directory.is_symlink() or (self.directory.exists() and not self.directory.is_dir()):
            raise OutputError.of_argument("out", f"found {str(self.directory)!r}, expected a folder")
        if self.is_begun:
            recorded = self.read(CONFIGURATION_NAME)
            if recorded == json.loads(json.dumps(configuration)):
                return
            if not force:
                changed = sorted(key for key in configuration if recorded.get(key) != configuration[key])
                if changed == ["versions"]:
                    raise ResultError(
                        f"{self.directory}: found an estimate begun with other versions of rpojax, Python or a "
                        "package, expected those in estimate.json, with which it ends with the same bits"
                    )
                raise OutputError.of_argument(
                    "out",
                    f"found an estimate with another {', '.join(changed) or 'content'}, expected a folder that is not "
                    "there yet, or that of the same estimate (or force=True)",
                )
            self._remove()
        elif self.directory.exists() and any(self.directory.iterdir()):
            raise OutputError.of_argument("out", f"found files in {str(self.directory)!r}, expected an empty folder")
        safe_paths.make_folder(self.directory.parent, self.directory)
        safe_paths.make_folder(self.directory, self.directory / BATCHES_NAME)
        self.write(CONFIGURATION_NAME, configuration)

    def write(self, name: str, content: dict[str, Any]) -> None:
        """Writes a file with the digest of its content.

        Raises:
            UnfinishedError: it cannot be written.
            ResultError: a part of its path is a symbolic link.
        """
        path = self.directory / name
        safe_paths.check_no_links(self.directory, path)
        atomic_files.write_json(path, {**content, "sha256": _digest(content)})

    def read(self, name: str) -> dict[str, Any]:
        """Content of a file, without its digest.

        Raises:
            ResultError: there is none, or its content is not what was written.
        """
        path = self.directory / name
        safe_paths.check_no_links(self.directory, path)
        content = atomic_files.read_json(path, "a file of an estimate", FileKind.PROGRESS)
        if not isinstance(content, dict) or content.pop("sha256", None) != _digest(content):
            raise ResultError(f"{path}: found content that does not match its digest, expected the file as written")
        return content

    @property
    def is_finished(self) -> bool:
        """Whether there is a result."""
        return (self.directory / RESULT_NAME).exists()

    def cached(self, function: LimitFunction) -> LimitFunction:
        """`function` with its margins cached in the folder."""

        def margins(points: LatentPoints) -> np.ndarray:
            parts = []
            for first in range(0, len(points), _MOST_POINTS):
                parts.append(self._margins(function, points.rows(slice(first, first + _MOST_POINTS))))
            return np.concatenate(parts)

        return margins

    def _margins(self, function: LimitFunction, points: LatentPoints) -> np.ndarray:
        name = f"{BATCHES_NAME}/{self._calls:06d}.json"
        self._calls += 1
        inputs = _digest_of_points(points)
        if (self.directory / name).exists():
            content = self.read(name)
            found = np.array([float.fromhex(text) for text in content["margins"]])
            if content["points_sha256"] != inputs or len(found) != len(points):
                raise ResultError(
                    f"{self.directory / name}: found margins of other points, expected those of this step: numpy, "
                    "scipy or the processor differ from those with which the estimate began"
                )
            return found
        found = function(points)
        self.write(name, {"points_sha256": inputs, "margins": [float(value).hex() for value in found]})
        return found

    def _remove(self) -> None:
        """Removes the files of an estimate, and nothing else."""
        for pattern in (CONFIGURATION_NAME, RESULT_NAME, f"{BATCHES_NAME}/*.json", "failing_runs/*.toml"):
            for path in self.directory.glob(pattern):
                path.unlink()


def _digest(content: dict[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, allow_nan=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _digest_of_points(points: LatentPoints) -> str:
    digest = hashlib.sha256(np.ascontiguousarray(points.x, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(points.keys, dtype="<u4").tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class RecordedEstimate:
    """Everything that determines an estimate to the last bit, except the versions of the packages.

    Attributes:
        file: the scenario
        choice: which runs fail
        settings: budget and method
        seed: master seed of runs and of the estimate
    """

    file: ScenarioFile
    choice: FailureChoice
    settings: EstimateSettings
    seed: int


def read_estimate(directory: Path) -> RecordedEstimate:
    """What the estimate in a folder was asked for, finished or not.

    Raises:
        ResultError: the folder has no estimate, or one that is not as it was written.
        RpojaxError: its scenario is invalid.
    """
    record = EstimateFolder(directory).read(CONFIGURATION_NAME)
    path = directory / CONFIGURATION_NAME
    for key, kind in _TYPES.items():
        if type(record.get(key)) is not kind:
            raise ResultError(f"{path}: found {record.get(key)!r:.60} as {key}, expected {kind.__name__}")
    if record["method"] not in _METHODS:
        raise ResultError(f"{path}: found method {record['method']!r:.60}, expected one of {', '.join(_METHODS)}")
    return RecordedEstimate(
        file=scenario_loader.validate_recorded(record["scenario"]),
        choice=_choice(path, record["failure"]),
        settings=EstimateSettings(budget=record["budget"], method=record["method"]),
        seed=record["seed"],
    )


def _choice(path: Path, failure: dict[str, Any]) -> FailureChoice:
    """The options that name a recorded failure."""
    outcome, metric, limit, bound = (failure.get(key) for key in ("outcome", "metric", "limit", "bound"))
    if isinstance(outcome, str) and metric is None:
        return FailureChoice(outcome=outcome)
    if not isinstance(metric, str) or not isinstance(bound, str) or type(limit) not in (int, float):
        raise ResultError(f"{path}: found failure {failure!r:.60}, expected an outcome, or a metric with its limit")
    if failure.get("required_probability") is not None:
        return FailureChoice(requirement=metric)
    return FailureChoice(metric=metric, limit=limit, bound=bound)


class _Failure(BaseModel):
    metric: str | None
    words: str


class _Requirement(BaseModel):
    allowed_probability_of_failure: FiniteFloat
    verdict: Literal["met", "violated", "open"]


class _Level(BaseModel):
    name: str
    evaluations: int
    probability: float | None
    threshold: float | None
    acceptance: float | None


class _PointDispersion(BaseModel):
    name: str
    sigmas: dict[str, float]
    values: dict[str, float | list[float]]
    nominal: dict[str, float | list[float]]


class _Point(BaseModel):
    distance_sigmas: FiniteFloat
    share: FiniteFloat
    dispersions: list[_PointDispersion]


class _RunDispersion(BaseModel):
    name: str
    sigmas: dict[str, float]


class _Run(BaseModel):
    distance_sigmas: FiniteFloat
    command: str
    dispersions: list[_RunDispersion]


class _Result(BaseModel):
    scenario: str
    scenario_hash: str
    seed: int
    probability: FiniteFloat
    interval_95: tuple[FiniteFloat, FiniteFloat]
    coefficient_of_variation: float | None
    evaluations: int
    method: str
    trusted: bool
    warnings: list[str]
    reason: str
    remark: str
    noise: str
    unmapped: list[str]
    plain_runs_for_equal_accuracy: float | None
    failure: _Failure
    requirement: _Requirement | None
    levels: list[_Level]
    design_points: list[_Point]
    failing_runs: list[_Run]


def read_result(directory: Path) -> dict[str, Any]:
    """Content of the result in a folder.

    Raises:
        ResultError: there is none, or one of its entries is missing or invalid.
    """
    content = EstimateFolder(directory).read(RESULT_NAME)
    try:
        _Result.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(map(str, fault["loc"]))
        raise ResultError(
            f"{directory / RESULT_NAME}: found {key:.80}: {fault['msg']:.80}, expected a result"
        ) from None
    return content
