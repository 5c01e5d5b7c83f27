"""Scenarios with a plugin: permission, hash, schema, metrics and what is refused."""

import hashlib
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from isolated_plugins import forgotten_plugins
from synthetic_channel_records import perfect_run

import rpojax
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.metrics import metric_catalogue, running_reduction
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.scenario_warnings import bad_side_warnings
from rpojax.scenario.measurement_delays import KEYS as DELAY_KEYS
from rpojax.scenario.plugins import custom_metrics, plugin_registry
from rpojax.scenario.plugins.plugin import described_plugin
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.simulation.metrics import recorded_metrics

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "docs" / "examples" / "plugin"


@pytest.fixture(autouse=True)
def isolated() -> Iterator[None]:
    with forgotten_plugins():
        yield


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """The example's scenario, beside its plugin, in a folder of its own."""
    for name in ("mine.py", "scenario.toml"):
        (tmp_path / name).write_text((EXAMPLE / name).read_text())
    return tmp_path / "scenario.toml"


@rpojax.metric("max")
def off_track_m(rho_H):
    """Largest distance from the track."""
    return jnp.hypot(rho_H[0], rho_H[2])


def end_range_m(range_m, time_s):
    return range_m[np.argmax(time_s)]


@pytest.mark.parametrize("low_is_bad", [False, True])
def test_a_requirement_that_contradicts_the_bad_side_of_its_metric_is_warned_of(low_is_bad: bool) -> None:
    marked = rpojax.metric(None, low_is_bad=low_is_bad)(lambda range_m: range_m[-1])
    plugin = rpojax.Plugin(metrics={"last_range_m": marked})
    entry = {"metric": "last_range_m", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
    for bound, is_warned in (("at least", not low_is_bad), ("at most", low_is_bad)):
        tables = scenario_loader.load("inspection").model_dump(exclude_unset=True) | plugin_registry.add(plugin)
        file = scenario_loader.validate(tables | {"requirements": [entry | {"bound": bound}]})
        found = bad_side_warnings(file)
        assert [f"low_is_bad={not low_is_bad}" in line for line in found] == [True] * is_warned
        both = [entry | {"bound": each} for each in ("at least", "at most")]
        assert bad_side_warnings(scenario_loader.validate(tables | {"requirements": both})) == []


def test_the_page_shows_the_files_of_the_example() -> None:
    page = (ROOT / "docs" / "how_to" / "plugins.md").read_text()
    shown = dict(re.findall(r"^```(toml|python)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[:2])
    assert shown == {"toml": (EXAMPLE / "scenario.toml").read_text(), "python": (EXAMPLE / "mine.py").read_text()}
    assert len(shown["python"].splitlines()) < 60


def test_a_plugin_is_not_executed_unless_it_is_allowed(example: Path) -> None:
    (example.parent / "mine.py").write_text("raise SystemExit('executed')")
    with pytest.raises(ScenarioError, match=r"plugin: found '.*mine.py:setup', expected allow_plugin=True"):
        rpojax.load(example)


def test_the_command_line_needs_its_option_and_says_so_in_one_line(example: Path) -> None:
    command = [sys.executable, "-m", "rpojax", "validate", str(example)]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    line = refused.stderr
    assert re.fullmatch(r"rpojax: error: plugin: found .* expected --allow-plugin, .*\n", line)
    allowed = subprocess.run([*command, "--allow-plugin"], capture_output=True, text=True, check=True)
    assert allowed.stdout.startswith("with a plugin: valid")


def test_an_override_does_not_exchange_the_plugin(example: Path) -> None:
    with pytest.raises(
        ScenarioError, match=r"found 'plugin=other.py:setup', expected plugin in the scenario file, which"
    ):
        rpojax.load(example, ["plugin=other.py:setup"], allow_plugin=True)


def test_a_scenario_carries_the_hash_of_its_plugin_and_the_sections_of_its_sensors(example: Path) -> None:
    file = rpojax.load(example, ["ranger.reach_m=35"], allow_plugin=True)
    digest = hashlib.sha256((example.parent / "mine.py").read_bytes()).hexdigest()
    assert (file.plugin, file.plugin_sha256) == (f"{example.parent / 'mine.py'}:setup", digest)
    assert isinstance(file, ScenarioFile)
    at_once = dict.fromkeys(DELAY_KEYS, 0.0)
    assert file.model_dump()["ranger"] == {"noise_m": 0.05, "reach_m": 35.0} | at_once
    assert [name for name, _ in static_settings(file).additional_sensors] == ["ranger"]
    assert plugin_registry.stages_of(file).formation_law.__name__ == "cautious_law"
    assert scenario_loader.validate(file.model_dump()) == file


def test_the_hash_of_a_scenario_depends_on_the_plugins_content_and_not_on_its_place(example: Path) -> None:
    here = rpojax.load(example, allow_plugin=True)
    other = example.parent / "other"
    other.mkdir()
    for name in ("mine.py", "scenario.toml"):
        (other / name).write_text((EXAMPLE / name).read_text())
    there = rpojax.load(other / "scenario.toml", allow_plugin=True)
    assert scenario_digest(there) == scenario_digest(here)
    (other / "mine.py").write_text((EXAMPLE / "mine.py").read_text() + "\n")
    assert scenario_digest(rpojax.load(other / "scenario.toml", allow_plugin=True)) != scenario_digest(here)


def test_a_file_that_has_changed_since_it_was_recorded_is_refused(example: Path) -> None:
    tables = rpojax.load(example, allow_plugin=True).model_dump()
    with forgotten_plugins():
        plugin_registry._KNOWN.clear()
        (example.parent / "mine.py").write_text((EXAMPLE / "mine.py").read_text() + "# changed\n")
        with pytest.raises(ScenarioError, match=r"plugin: .* expected a file with the SHA-256"):
            plugin_registry.load_for(dict(tables), allow=True)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("def setup(:\n", "SyntaxError"),
        ("import no_such_package\n", "ModuleNotFoundError"),
        ("x = 1\n", "expected a function 'setup'"),
        ("def setup():\n    return 3\n", "expected a function that returns rpojax.Plugin"),
        ("def setup():\n    raise ValueError('no')\n", r"ValueError \(no\)"),
        ("x = '" + "a" * 1_000_000 + "'\n", "more than 1000000 bytes"),
    ],
)
def test_a_file_that_is_no_plugin_is_refused_in_one_line(example: Path, source: str, expected: str) -> None:
    (example.parent / "mine.py").write_text(source)
    with pytest.raises(ScenarioError, match=expected) as refused:
        rpojax.load(example, allow_plugin=True)
    assert "\n" not in str(refused.value)


def test_an_argument_that_a_stage_does_not_have_is_named(example: Path) -> None:
    source = (example.parent / "mine.py").read_text()
    (example.parent / "mine.py").write_text(source.replace("deviation", "deviaton"))
    with pytest.raises(RpojaxError, match=r"^stages\.formation_law: found the argument 'deviaton', expected .*deviat"):
        rpojax.load(example, allow_plugin=True)


@pytest.mark.parametrize("reference", ["mine.py", "mine.py:", ":setup", "no_such.py:setup", 3])
def test_a_reference_of_another_form_is_refused(example: Path, reference: object) -> None:
    example.write_text(example.read_text().replace('"mine.py:setup"', repr(reference)))
    with pytest.raises(ScenarioError, match="plugin: found"):
        rpojax.load(example, allow_plugin=True)


def test_metrics_from_python_have_their_units_and_are_evaluated_for_their_scenario_alone() -> None:
    plain = rpojax.load("inspection")
    file = rpojax.load("inspection", plugin=rpojax.Plugin({"off_track_m": off_track_m, "end_range_m": end_range_m}))
    records = perfect_run(ticks=90, runs=2)
    records["rho_H"][1, 40] = (3.0, -30.0, -4.0)
    records["range_m"][:, -1] = (25.0, 26.0)
    found = recorded_metrics.evaluate(file, records, {})
    np.testing.assert_allclose(found["off_track_m"], [0.0, 5.0], rtol=1e-12)
    np.testing.assert_array_equal(found["end_range_m"], [25.0, 26.0])
    assert metric_catalogue.unit_of("off_track_m") == "m"
    known = plugin_registry.catalogue_of(file)
    assert known["off_track_m"].has_derivative
    assert not known["end_range_m"].has_derivative
    assert not {"off_track_m", "end_range_m"} & {*plugin_registry.catalogue_of(plain), *metric_catalogue.METRICS}
    assert set(recorded_metrics.evaluate(plain, records, {})) == set(found) - {"off_track_m", "end_range_m"}
    assert scenario_digest(plain) != scenario_digest(file)


def test_ticks_without_a_finite_value_do_not_count_and_a_run_without_any_is_undefined() -> None:
    @rpojax.metric("mean")
    def score(range_m):
        return jnp.where(range_m > 20.0, range_m, jnp.nan)

    file = rpojax.load("inspection", plugin=rpojax.Plugin({"score": score}))
    records = perfect_run(ticks=9, runs=2)
    records["range_m"][0] = [10.0] * 4 + [30.0] * 3 + [40.0] * 2
    records["range_m"][1] = 5.0
    np.testing.assert_allclose(recorded_metrics.evaluate(file, records, {})["score"], [34.0, np.nan])


@pytest.mark.parametrize("differentiate", [jax.jacfwd, jax.jacrev])
def test_ticks_without_a_finite_value_do_not_enter_the_derivative_in_either_mode(differentiate: Callable) -> None:
    @rpojax.metric("mean")
    def root(range_m, is_eclipsed):
        return jnp.where(is_eclipsed, jnp.sqrt(range_m - 20.0), jnp.nan)

    definition = custom_metrics.make_metric("root", root, "-")
    ranges = [24.0, 10.0, 29.0, 5.0]

    def value(factor: jax.Array, ranges: list[float]) -> jax.Array:
        sums = running_reduction.initial_accumulators([definition])
        for tick, length in enumerate(ranges):
            inputs = {"range_m": factor * length, "is_eclipsed": jnp.asarray(True)}
            sums = running_reduction.accumulate([definition], inputs, sums, jnp.int32(tick), len(ranges), 1.0)
        return running_reduction.final_values([definition], sums)[0]

    assert value(jnp.ones(()), ranges) == 2.5
    # Of sqrt(24 x - 20) and sqrt(29 x - 20) at x = 1.
    assert differentiate(value)(1.0, ranges) == pytest.approx(0.5 * (24.0 / 4.0 + 29.0 / 6.0))
    assert np.isnan(value(jnp.ones(()), ranges[1::2]))
    assert differentiate(value)(1.0, ranges[1::2]) == 0.0


def test_a_requirement_in_a_window_may_name_a_metric_of_the_plugin() -> None:
    plugin = rpojax.Plugin({"off_track_m": off_track_m})
    tables = rpojax.load("inspection", ["duration_s=90.0"], plugin=plugin).model_dump()
    limit = {"metric": "off_track_m", "bound": "at most", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
    file = scenario_loader.validate({**tables, "requirements": [limit | {"from_s": 30.0, "to_s": 60.0}]})
    records = perfect_run(ticks=90) | {"running": np.ones((1, 90), bool)}
    records["rho_H"][0, 10] = (9.0, -30.0, 0.0)
    records["rho_H"][0, 50] = (2.0, -30.0, 0.0)
    found = recorded_metrics.evaluate_windows(file, records, {})
    np.testing.assert_allclose(found["off_track_m@30-60"], [2.0])


def test_a_requirement_or_weight_on_a_metric_of_another_scenarios_plugin_is_refused(example: Path) -> None:
    tables = rpojax.load(example, allow_plugin=True).model_dump()
    bare = {key: value for key, value in tables.items() if key not in ("plugin", "plugin_sha256", "ranger")}
    bare["dispersions"] = []
    with pytest.raises(ScenarioError, match=r"requirements.\d+.metric: found 'docking_angle_deg'"):
        scenario_loader.validate(bare)
    with pytest.raises(ScenarioError, match=r"tuning.metrics.docking_angle_deg"):
        scenario_loader.validate({**bare, "requirements": []})


@pytest.mark.parametrize(
    ("plugin", "expected"),
    [
        (lambda: rpojax.Plugin({"min_range_m": off_track_m}), "a name that no metric of the package has"),
        (lambda: rpojax.Plugin({"Bad name": off_track_m}), "small letters"),
        (lambda: rpojax.Plugin({"a_m": lambda *channels: 0.0}), "the names of channels"),
        (lambda: rpojax.Plugin(sensors={"gps": rpojax.AdditionalSensor}), "one that no section of a scenario has"),
        (lambda: rpojax.Plugin(sensors={"ranger": dict}), "a subclass of rpojax.AdditionalSensor"),  # type: ignore[dict-item]
    ],
)
def test_what_cannot_be_added_is_refused(plugin: object, expected: str) -> None:
    assert callable(plugin)
    with pytest.raises(RpojaxError, match=expected):
        rpojax.load("inspection", plugin=plugin())


def test_a_description_reads_results_and_refuses_to_simulate(example: Path) -> None:
    file = rpojax.load(example, allow_plugin=True)
    tables, plugin = file.model_dump(mode="json"), plugin_registry.plugin_of(file)
    assert plugin is not None
    record = plugin.describe()
    metric_catalogue._OF_PLUGINS.clear()
    plugin_registry._KNOWN.clear()
    plugin_registry.add_description(tables, record)
    read = scenario_loader.validate(tables)
    assert read.model_dump(mode="json") == tables
    found = metric_catalogue.find("docking_angle_deg")
    assert found is not None
    assert found.title == "Largest angle off the track"
    assert scenario_digest(read) == scenario_digest(file)
    with pytest.raises(ScenarioError, match=r"plugin: .* expected allow_plugin=True"):
        plugin_registry.stages_of(read)


@pytest.mark.parametrize("record", [{}, {"metrics": 3, "sensors": []}, {"metrics": {"a": 1}}])
def test_a_spoilt_description_is_that_of_nothing(record: dict) -> None:
    assert described_plugin(record).definitions == {}
