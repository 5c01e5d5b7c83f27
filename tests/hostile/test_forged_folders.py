"""Folders that were edited: a change of identity, blocks, histories or requirements is refused, never believed."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hostile_classes import small_campaign
from hostile_folders import json_fields, results_digest, with_field
from rewritten_campaigns import rewrite_campaign

from rpojax.campaign.requirement_revision import change_requirements
from rpojax.campaign.storage.arrays import zarr_encoding
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, RpojaxError
from rpojax.report.sections import caveats_section, requirement_verdict_section

REQUIREMENT = """[[requirements]]
metric = "min_range_m"
bound = "at least"
limit = {limit}
probability = 0.5
consumer_risk = 0.1
"""


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished campaign of synthetic runs; not to be changed."""
    return small_campaign(tmp_path_factory.mktemp("forged"))


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    """A copy of the campaign, free to be changed."""
    return Path(shutil.copytree(original, tmp_path / "runs"))


def edit(path: Path, change: Callable[[Any], object]) -> None:
    """Changes the content of a JSON file."""
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


CHANGES: dict[str, Callable[[Any], object]] = {
    "seed": lambda content: content.update(seed=8),
    "first_run": lambda content: content.update(first_run=1),
    "scenario_hash": lambda content: content.update(scenario_hash="0" * 64),
    "scenario": lambda content: content["scenario"]["servicer"].update(mass_kg=25.0),
    "requirement": lambda content: content["scenario"]["requirements"][0].update(limit=100.0),
    "dtype": lambda content: content.update(dtype="float32"),
    "design": lambda content: content["design"].update(runs=6),
    "no seal": lambda content: content.pop("seal"),
    "older format": lambda content: content.update(format=3),
    "older format without seal": lambda content: (content.pop("seal"), content.update(format=3)),
    "another entry": lambda content: content.update(comment="x"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_identity_is_refused(folder: Path, name: str) -> None:
    edit(folder / "campaign.json", CHANGES[name])
    with pytest.raises(ResultError, match="seal"):
        Campaign(folder).verify()


def test_exchanged_histories_and_blocks_are_refused(folder: Path) -> None:
    histories = folder / "results.zarr" / "histories"
    (histories / "0").rename(histories / "2")
    (histories / "1").rename(histories / "0")
    (histories / "2").rename(histories / "1")
    with pytest.raises(ResultError, match="found other values"):
        Campaign(folder).history(0)
    chunks = folder / "results.zarr" / "metrics" / "min_range_m" / "c"
    one, other = (chunks / "0").read_bytes(), (chunks / "1").read_bytes()
    (chunks / "0").write_bytes(other)
    (chunks / "1").write_bytes(one)
    with pytest.raises(ResultError, match="found other values in block 0"):
        _ = Campaign(folder).metrics


def test_equal_values_of_other_runs_are_told_apart(folder: Path) -> None:
    campaign = Campaign(folder)
    arrays = {"min_range_m": campaign.metrics["min_range_m"][:2]}
    digests = {zarr_encoding.digest(arrays, campaign._binding("metrics", block)) for block in (0, 1)}
    assert len(digests) == 2


@pytest.mark.parametrize("group", ["drawn", "status"])
def test_digests_that_are_deleted_from_a_manifest_are_missed(folder: Path, group: str) -> None:
    edit(folder / "manifest" / "000000.json", lambda content: content["sha256"].pop(group))
    with pytest.raises(ResultError, match="entries that differ from its seal"):
        _ = Campaign(folder).drawn


@pytest.mark.parametrize("name", ["00000\u0661.json", "\u0660\u0660\u0660\u0660\u0660\u0661.json"])
def test_digits_of_other_scripts_are_no_numbers_of_blocks(folder: Path, name: str) -> None:
    path = folder / "manifest" / "000001.json"
    path.rename(path.with_name(name))
    assert Campaign(folder).missing_blocks() == [1]


def test_an_absurd_shape_is_refused_before_anything_is_read(folder: Path) -> None:
    path = folder / "results.zarr" / "traces" / "range_m" / "zarr.json"
    edit(path, lambda content: content.update(shape=[5, 4 * 10**11]))
    with pytest.raises(ResultError, match=r"expected one that its files of .* bytes can hold"):
        Campaign(folder).verify()


def test_fields_of_every_json_file_are_checked_or_without_effect(folder: Path) -> None:
    """Some of each file; `experiments/hostile_input` takes all of them."""
    expected, unlike, tried = results_digest(folder), [], 0
    for path in sorted(folder.rglob("*.json")):
        before = path.read_text()
        fields = list(json_fields(json.loads(before)))
        for field in fields[:: max(1, len(fields) // 12)]:
            path.write_text(with_field(json.loads(before), field, '"x"'))
            tried += 1
            try:
                if results_digest(folder) != expected:
                    unlike.append((path.name, field))
            except RpojaxError:
                pass
        path.write_text(before)
    assert unlike == []
    assert tried > 100


def unseal(folder: Path) -> None:
    """Makes a folder one of an older version, which knew no seal."""

    def strip(content: Any) -> None:
        for key in ("seal", "campaign_seal"):
            content.pop(key, None)

    campaign = Campaign(folder)
    arrays = {block: {} for block in campaign.manifests}
    for group in ("metrics", "drawn", "traces"):
        for block, entry in campaign.manifests.items():
            arrays[block][group] = {
                name: values[entry.first : entry.first + entry.count]
                for name, values in getattr(campaign, group).items()
            }
    status = campaign._read("status")
    edit(folder / "campaign.json", lambda content: (strip(content), content.update(format=3)))
    shutil.rmtree(folder / "results.zarr" / "histories")
    for block, groups in arrays.items():
        entry = campaign.manifests[block]
        groups["status"] = {name: values[entry.first : entry.first + entry.count] for name, values in status.items()}
        digests = {group: zarr_encoding.digest(values) for group, values in groups.items()}
        edit(
            folder / "manifest" / f"{block:06d}.json",
            lambda content, digests=digests: (strip(content), content.update(sha256=digests)),
        )


def test_a_folder_without_a_seal_has_figures_and_no_verdicts(folder: Path, tmp_path: Path) -> None:
    rewrite_campaign(folder, scenario=_with_requirement(Campaign(folder).configuration.scenario))
    sealed = Campaign(folder)
    [entry] = requirement_verdict_section.content(sealed, 0)
    unseal(folder)
    older = Campaign(folder)
    assert not older.is_sealed
    [found] = requirement_verdict_section.content(older, 0)
    assert (found["verdict"], found["success_interval"]) == ("unsealed: no verdict", None)
    assert (found["worst"], found["violations"]) == (entry["worst"], entry["violations"])
    assert "unsealed" in caveats_section._seal_caveats(older)[0]
    with pytest.raises(ResultError, match="found no seal"):
        change_requirements(older, _file(tmp_path, 1.0), "a reason")


def test_changed_requirements_are_recorded_in_a_chain(folder: Path, tmp_path: Path) -> None:
    before = Campaign(folder).requirements
    first = change_requirements(Campaign(folder), _file(tmp_path, 1.0), "first")
    assert [each.limit for each in first.requirements] == [1.0]
    assert first.file.requirements == before
    second = change_requirements(first, _file(tmp_path, 2.0), "second")
    assert [change.reason for change in second.requirement_changes] == ["first", "second"]
    sentences = caveats_section._seal_caveats(second)
    assert "first" in sentences[0]
    assert "min_range_m at least 2.0" in sentences[1]
    edit(folder / "requirements" / "000001.json", lambda content: content["requirements"][0].update(limit=0.0))
    with pytest.raises(ResultError, match="entries that differ from its seal"):
        Campaign(folder)
    (folder / "requirements" / "000001.json").unlink()
    with pytest.raises(ResultError, match="found another change than number 1"):
        Campaign(folder)


@pytest.mark.parametrize(
    ("text", "reason", "error"),
    [
        (REQUIREMENT.format(limit=1.0), " ", "--?reason|reason: missing"),
        (REQUIREMENT.format(limit=1.0).replace("min_range_m", "nees_mean"), "x", "a metric that the campaign recorded"),
        (REQUIREMENT.format(limit=1.0) + "[servicer]\nmass_kg = 3.0\n", "x", "alone"),
        ("requirements = 3", "x", "requirements"),
        ("", "x", "requirements"),
    ],
)
def test_what_is_no_list_of_requirements_is_refused(
    folder: Path, tmp_path: Path, text: str, reason: str, error: str
) -> None:
    file = tmp_path / "requirements.toml"
    file.write_text(text)
    with pytest.raises(RpojaxError, match=error):
        change_requirements(Campaign(folder), file, reason)
    assert not (folder / "requirements").exists()


def _file(folder: Path, limit: float) -> Path:
    file = folder / "requirements.toml"
    file.write_text(REQUIREMENT.format(limit=limit))
    return file


def _with_requirement(scenario: dict[str, Any]) -> dict[str, Any]:
    [kept] = [each for each in scenario["requirements"] if each["metric"] == "min_range_m"]
    return {**scenario, "requirements": [kept]}
