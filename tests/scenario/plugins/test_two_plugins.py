"""Two scenarios of one process whose plugins define metrics and sensors of the same name."""

import inspect
import json
import linecache
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from empty_campaign_folders import empty_campaign, synthetic_timing
from isolated_plugins import forgotten_plugins
from synthetic_campaign_results import synthetic_campaign
from synthetic_channel_records import perfect_run

import rpojax
from rpojax.analysis.gradients.derivative_sensitivity import select_metrics
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability.search_settings import LimitChoice
from rpojax.analysis.reliability.simulated_limit_state import select_limit
from rpojax.campaign.execution import block_runner
from rpojax.core.declared_numbers import declared_numbers
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.metrics import metric_catalogue
from rpojax.report.page.html_report import write_report
from rpojax.scenario.dispersed_numbers.dispersed_values import apply_to_params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import leaf_path_and_factor
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.measurement_delay import MeasurementDelay
from rpojax.simulation.metrics import recorded_metrics


@pytest.fixture(autouse=True)
def isolated() -> Iterator[None]:
    with forgotten_plugins():
        yield


@rpojax.metric("max", title="Largest range", unit="m")
def largest(range_m):
    """Largest range."""
    return range_m


@rpojax.metric("min", title="Least range", unit="km", low_is_bad=True)
def least(range_m):
    """Least range."""
    return 1e-3 * range_m


LIMIT = {"metric": "score", "bound": "at most", "limit": 40.0, "probability": 0.9, "consumer_risk": 0.1}


def scenario(function: Callable[..., Any]) -> ScenarioFile:
    """A scenario with a metric `score`, and a requirement on it."""
    tables = rpojax.load("inspection", ["duration_s=90.0"], plugin=rpojax.Plugin({"score": function})).model_dump()
    return scenario_loader.validate({**tables, "requirements": [LIMIT]})


def test_each_scenario_has_its_own_definition_in_whatever_order_they_were_loaded() -> None:
    files = scenario(largest), scenario(least)
    records = perfect_run(ticks=9)
    records["range_m"][0] = np.linspace(20.0, 60.0, 9)
    for file, value, unit in ((files[0], 60.0, "m"), (files[1], 0.02, "km"), (files[0], 60.0, "m")):
        assert recorded_metrics.evaluate(file, records, {})["score"] == pytest.approx([value])
        assert plugin_registry.catalogue_of(file)["score"].unit == unit
        evaluator = RolloutEvaluator(file, lambda inputs, _: {}, 1, ("score",), runs=1)
        assert [each.unit for each in evaluator._metrics] == [unit]
        assert scenario_loader.validate(file.model_dump()) == file


def test_a_name_that_plugins_define_differently_is_refused_where_no_scenario_is_at_work() -> None:
    file = scenario(largest)
    assert metric_catalogue.unit_of("score") == "m"
    scenario(least)
    with pytest.raises(RpojaxError) as caught:
        metric_catalogue.unit_of("score")
    assert str(caught.value) == (
        "metrics.score: found 'Largest range' [m] and 'Least range' [km] in plugins of this process, "
        "expected one definition"
    )
    with metric_catalogue.metrics_of_scenario(plugin_registry.metrics_of(file)):
        assert metric_catalogue.unit_of("score") == "m"
        assert metric_catalogue.worst_first("score", np.array([1.0, 2.0])).tolist() == [1, 0]


def test_a_scenario_without_a_plugin_has_no_metric_of_another_ones() -> None:
    scenario(largest)
    plain = rpojax.load("inspection")
    assert "score" not in plugin_registry.catalogue_of(plain)
    assert "score" not in recorded_metrics.evaluate(plain, perfect_run(ticks=9), {})
    with pytest.raises(ScenarioError, match="'score', expected the name of a metric"):
        scenario_loader.validate({**plain.model_dump(), "requirements": [LIMIT]})
    with pytest.raises(RpojaxError, match="found 'score', expected a metric with a derivative"):
        select_metrics(plain, ["score"])
    with pytest.raises(RpojaxError, match="found 'score', expected a metric: "):
        select_limit(plain, LimitChoice(None, "score", 1.0, "at most"))


def test_a_report_tells_of_the_metric_as_its_own_campaign_defines_it(tmp_path: Path) -> None:
    described = {}
    for name, function in (("a", largest), ("b", least)):
        plugin = plugin_registry.plugin_of(scenario(function))
        assert plugin is not None
        described[name] = plugin.describe()
    for name, unit, title in (("a", "m", "Largest range"), ("b", "km", "Least range")):
        (tmp_path / name).mkdir()
        campaign = synthetic_campaign(tmp_path / name, runs=12)
        campaign.info["plugin"] = described[name]
        campaign.metrics["score"] = np.arange(12.0)
        page = write_report(campaign, film=False, progress=False).read_text()
        content = json.loads((tmp_path / name / "report.json").read_text())
        assert content["metrics"]["score"]["unit"] == unit
        assert title in page
        assert ({"Largest range", "Least range"} - {title}).pop() not in page
    plain = synthetic_campaign(tmp_path, runs=12)
    write_report(plain, film=False, progress=False)
    assert "score" not in json.loads((tmp_path / "report.json").read_text())["metrics"]


SCALED = """
import types
import rpojax

FACTOR = {0}
held = types.SimpleNamespace(factor={0})


class Held:
    pass


Held.factor = {0}


def scale(x):
    return FACTOR * x


@rpojax.metric("max", title="By a global", unit="m")
def by_global(range_m):
    return FACTOR * range_m


@rpojax.metric("max", title="By a helper", unit="m")
def by_helper(range_m):
    return scale(range_m)


@rpojax.metric("max", title="By a namespace", unit="m")
def by_namespace(range_m):
    return held.factor * range_m


@rpojax.metric("max", title="By a class", unit="m")
def by_class(range_m):
    return Held.factor * range_m
"""


@pytest.mark.parametrize("name", ["by_global", "by_helper", "by_namespace", "by_class"])
def test_functions_of_one_source_that_read_other_values_are_other_plugins(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    files = []
    for factor in (1.0, 3.0, 1.0):
        path = tmp_path / f"scaled_{name}.py"
        path.write_text(SCALED.format("FROM_OUTSIDE"))
        module = types.ModuleType(path.stem)
        exec(compile(f"FROM_OUTSIDE = {factor}", "outside", "exec"), vars(module))
        linecache.checkcache(str(path))
        exec(compile(path.read_text(), str(path), "exec"), vars(module))
        monkeypatch.setitem(sys.modules, path.stem, module)
        files.append(scenario(getattr(module, name)))
    assert files[0].plugin_sha256 == files[2].plugin_sha256 != files[1].plugin_sha256
    records = perfect_run(ticks=9)
    records["range_m"][0] = np.linspace(20.0, 60.0, 9)
    for file, value in zip(files, (60.0, 180.0, 60.0), strict=True):
        assert recorded_metrics.evaluate(file, records, {})["score"] == pytest.approx([value])


PLUGIN = """
import rpojax

@rpojax.metric("{}")
def score(range_m):
    return range_m

def setup():
    return rpojax.Plugin(metrics={{"score_m": score}})
"""


def test_a_file_that_is_loaded_twice_has_one_definition_and_an_edited_one_a_new(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('extends = "inspection"\nname = "mine"\ndescription = "."\nplugin = "mine.py:setup"\n')
    (tmp_path / "mine.py").write_text(PLUGIN.format("max"))
    one, same = (rpojax.load(path, allow_plugin=True) for _ in range(2))
    (tmp_path / "mine.py").write_text(PLUGIN.format("min"))
    edited = rpojax.load(path, allow_plugin=True)
    assert one == same
    assert one.plugin_sha256 != edited.plugin_sha256
    records = perfect_run(ticks=9)
    records["range_m"][0] = np.linspace(20.0, 60.0, 9)
    for file, value in ((one, 60.0), (edited, 20.0), (same, 60.0)):
        assert recorded_metrics.evaluate(file, records, {})["score_m"] == pytest.approx([value])
        assert scenario_loader.validate(file.model_dump()) == file


def test_an_edited_law_leaves_the_metrics_of_its_file_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('extends = "inspection"\nname = "mine"\ndescription = "."\nplugin = "mine.py:setup"\n')
    digests = []
    for gain, reduction in ((1.0, "max"), (2.0, "max"), (1.0, "min")):
        law = f"def law(deviation):\n    return {gain} * deviation[:3]\n\n"
        (tmp_path / "mine.py").write_text(PLUGIN.format(reduction).replace("def setup", f"{law}def setup"))
        file = rpojax.load(path, allow_plugin=True)
        plugin = plugin_registry.plugin_of(file)
        assert plugin is not None
        digests.append(plugin.describe()["metrics"]["score_m"]["sha256"])
    assert digests[0] == digests[1] != digests[2]


OPAQUE = {
    "a compiled helper": "@jax.jit\ndef helper(x):\n    return {0} * x\n",
    "an array of JAX": "SCALE = jnp.array({0})\n\ndef helper(x):\n    return SCALE * x\n",
    "a function with its arguments": "def times(a, x):\n    return a * x\n\nhelper = functools.partial(times, {0})\n",
    "a function of a function": "def made(a):\n    return lambda x: a * x\n\nhelper = made({0})\n",
    "a default argument": "def helper(x, a={0}):\n    return a * x\n",
    "an object": "class Times:\n    def __init__(self, a):\n        self.a = a\n    def __call__(self, x):\n"
    "        return self.a * x\n\nhelper = Times({0})\n",
}


@pytest.mark.parametrize("kind", OPAQUE)
def test_a_metric_is_another_one_if_what_it_calls_is(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('extends = "inspection"\nname = "mine"\ndescription = "."\nplugin = "mine.py:setup"\n')
    digests = []
    for number in (2.0, 3.0):
        imports = "import functools\nimport jax\nimport jax.numpy as jnp\n" + OPAQUE[kind].format(number)
        text = PLUGIN.format("max").replace("return range_m", "return helper(range_m)")
        (tmp_path / "mine.py").write_text(imports + text)
        plugin = plugin_registry.plugin_of(rpojax.load(path, allow_plugin=True))
        assert plugin is not None
        digests.append(plugin.describe()["metrics"]["score_m"]["sha256"])
    assert digests[0] != digests[1]


class Near(rpojax.AdditionalSensor):
    """Sensor with one key."""

    noise_m: float
    normals = 0

    @staticmethod
    def measure(settings, scene, normals):
        return {"near": jnp.zeros(())}


class Far(rpojax.AdditionalSensor):
    """Sensor of the same name with another key."""

    reach_m: float
    normals = 0

    @staticmethod
    def measure(settings, scene, normals):
        return {"far": jnp.zeros(())}


def test_sensors_of_one_name_have_the_keys_of_their_own_plugin() -> None:
    overrides = {Near: ["beam.noise_m=1.0"], Far: ["beam.reach_m=2.0"]}
    for cls in (Near, Far, Near):
        file = rpojax.load("inspection", overrides[cls], plugin=rpojax.Plugin(sensors={"beam": cls}))
        assert dict(rpojax.nominal_parameters(file)[0].additional_sensors) == {"beam": cls}
    assert leaf_path_and_factor("beam.noise_m") == (("additional_sensors", "beam", "noise"), 1.0)
    assert leaf_path_and_factor("beam.reach_m") == (("additional_sensors", "beam", "reach"), 1.0)
    with pytest.raises(ScenarioError):
        rpojax.load("inspection", overrides[Far], plugin=rpojax.Plugin(sensors={"beam": Near}))


def believed_beam(believed: tuple[str, ...]) -> type[rpojax.AdditionalSensor]:
    class Beam(rpojax.AdditionalSensor):
        noise_m: float
        sigma_m: float
        normals = 1
        row_count = 1
        beliefs = believed

        @staticmethod
        def measure(settings, scene, normals):
            return {"beam_m": settings["noise"] * normals[0]}

        @staticmethod
        def rows(beliefs, view, measured):
            return view.rows(lambda _: jnp.zeros(1), measured["beam_m"][None], jnp.ones(1), jnp.asarray(True))

    return Beam


def test_sensors_of_one_name_and_the_same_keys_have_the_beliefs_of_their_own_plugin() -> None:
    narrow, wide = believed_beam(("sigma_m",)), believed_beam(("noise_m", "sigma_m"))
    inherited = [type("Own", (each,), {"__module__": __name__}) for each in (narrow, wide)]
    for one, other in ((narrow, wide), tuple(inherited)):
        files = [
            rpojax.load(
                "inspection", ["beam.noise_m=1.0", "beam.sigma_m=2.0"], plugin=rpojax.Plugin({}, {"beam": each})
            )
            for each in (one, other, one)
        ]
        assert files[0].plugin_sha256 == files[2].plugin_sha256 != files[1].plugin_sha256
        # The static settings are the key of the compiled program.
        scenarios = [rpojax.nominal_parameters(file)[0] for file in files]
        assert scenarios[0] == scenarios[2] != scenarios[1]
        for file, beliefs in zip(files, ({"sigma"}, {"noise", "sigma"}, {"sigma"}), strict=True):
            params = rpojax.nominal_parameters(file)[1]
            assert set(params.flight.sensors["beam"]) == beliefs
            of_truth = set(params.additional_sensors["beam"]) - set(declared_numbers(MeasurementDelay))
            assert of_truth == {"noise", "sigma"} - beliefs
            dispersed = apply_to_params(params, {"beam.noise_m": jnp.asarray(5.0)})
            holder = dispersed.flight.sensors if "noise" in beliefs else dispersed.additional_sensors
            assert holder["beam"]["noise"] == 5.0


def test_a_believed_sensor_has_no_name_of_a_sensor_that_every_filter_has() -> None:
    with pytest.raises(RpojaxError, match="found 'nis_box_mean', expected a name that no metric of the package has"):
        rpojax.load("inspection", plugin=rpojax.Plugin({}, {"box": believed_beam(("sigma_m",))}))


def test_rows_tell_metrics_of_sensors_of_one_name_apart() -> None:
    one, two = (believed_beam(("sigma_m",)) for _ in range(2))
    two.row_count = 2
    for each in (one, two):
        rpojax.Plugin({}, {"beam": each}).activate()
    with pytest.raises(RpojaxError) as caught:
        metric_catalogue.find("nis_beam_mean")
    assert str(caught.value) == (
        "metrics.nis_beam_mean: found 'NIS, beam' [-] of 1 degrees of freedom and 'NIS, beam' [-] of 2 degrees of "
        "freedom in plugins of this process, expected one definition"
    )


class SyntheticBlock:
    """What a device has simulated of two runs."""

    prepared = SimpleNamespace(run_ids=np.arange(2))

    def block_arrays(self, rows: slice, engine: Any) -> dict[str, np.ndarray]:
        status = {"status/failure": np.zeros(2, np.int8), "status/failed_at_s": np.full(2, np.nan)}
        return status | {"metrics/score": np.arange(2.0), "traces/range_m": np.zeros((2, 9), np.float32)}


def test_a_stored_metric_has_the_unit_of_its_own_campaign(tmp_path: Path) -> None:
    files = {"m": scenario(largest), "km": scenario(least)}
    for unit, file in files.items():
        campaign = empty_campaign(tmp_path / unit, file, 0, 2, 0, 2)
        results: Any = SimpleNamespace(blocks=(0,), batch=SyntheticBlock(), timing=synthetic_timing())
        engine: Any = SimpleNamespace(runs_per_device=2, file=file)
        inspect.unwrap(block_runner.store_blocks)(campaign, engine, results)  # without its check of types
        stored = json.loads((tmp_path / unit / "results.zarr" / "metrics" / "score" / "zarr.json").read_text())
        assert stored["attributes"]["units"] == unit
