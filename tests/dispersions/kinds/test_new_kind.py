"""A kind of dispersion is one class and an entry of the registry: with them it is checked, drawn and linearised."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dispersed_samples import draw
from pydantic import Field
from scenario_variants import with_dispersions
from scipy.stats import triang

from rpojax.analysis.linear_covariance.linearisation.dispersion_linearisation import linearise_dispersions
from rpojax.analysis.statistics.dispersion_marginals import drawn_marginals, goodness_of_fit_p
from rpojax.campaign import dry_run
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.dispersions.kinds import registry
from rpojax.dispersions.kinds.dispersion_kind import ExtremeValue, SingleKeyKind
from rpojax.dispersions.kinds.registry import Dispersion
from rpojax.dispersions.marginal_distribution import Distribution
from rpojax.dispersions.random_source import RandomSource
from rpojax.errors import ScenarioError
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.value_types import Positive

MASS_KG = 30.0
ENTRY: dict[str, Any] = {"key": "servicer.mass_kg", "kind": "triangular", "half_width": 2.0}


class Triangular(SingleKeyKind):
    """Triangular about the nominal value, per component."""

    kind: Literal["triangular"]
    half_width: Positive

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Any numbers may be triangular, but not matrices."""
        if nominal.ndim > 1:
            raise ScenarioError(f"{where}.key", self.key, "the key of a number or a vector")

    def extreme_values(self, shape: tuple[int, ...]) -> list[ExtremeValue]:
        """No width of a positive number may exceed the number itself, here in kilograms."""
        lowest = np.full(shape, MASS_KG - self.half_width).tolist()
        return [ExtremeValue("half_width", self.half_width, lowest, whole=False)]

    def draw(self, nominal: jax.Array, source: RandomSource) -> jax.Array:
        """Value of one run, in the unit of the key."""
        u = source.uniforms(nominal.shape)
        rising, falling = jnp.sqrt(2.0 * u) - 1.0, 1.0 - jnp.sqrt(2.0 * (1.0 - u))
        return nominal + self.half_width * jnp.where(u < 0.5, rising, falling)

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component about `nominal` (n,)."""
        return [triang(0.5, mean - self.half_width, 2.0 * self.half_width) for mean in nominal]

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (...) of a value, and its change (size, size) per sigma of standard normal inputs."""
        return nominal, self.half_width / np.sqrt(6.0) * np.eye(nominal.size)


if TYPE_CHECKING:
    Extended = Any
else:
    Extended = Annotated[get_args(Dispersion)[0] | Triangular, Field(discriminator="kind")]


class ExtendedFile(ScenarioFile):
    """Schema with the extended union."""

    dispersions: list[Extended]


@pytest.fixture
def file(monkeypatch: pytest.MonkeyPatch, mission: ScenarioFile) -> Callable[..., ScenarioFile]:
    """The short scenario with given dispersions, where the registry has the new kind."""
    monkeypatch.setattr(registry, "Dispersion", Extended)
    monkeypatch.setattr(plugin_registry, "ScenarioFile", ExtendedFile)
    return lambda *entries: with_dispersions(mission, *entries)


def test_its_settings_are_checked(file: Callable[..., ScenarioFile]) -> None:
    with pytest.raises(ScenarioError, match=r"^dispersions.0.half_width: found -1.0, expected greater than 0"):
        file(ENTRY | {"half_width": -1.0})
    with pytest.raises(ScenarioError, match=r"^dispersions.0.half_width: found 31.0, expected what servicer.mass_kg"):
        file(ENTRY | {"half_width": 31.0})
    with pytest.raises(ScenarioError, match=r"^dispersions.0.key: found 'servicer.inertia_kg_m2', expected the key of"):
        file(ENTRY | {"key": "servicer.inertia_kg_m2"})
    with pytest.raises(ScenarioError, match=r"^dispersions.0.kind: found 'triangular', expected 'choice' for faults"):
        file(ENTRY | {"key": "faults.fault.wheel"})


def of_a_design(file: Callable[..., ScenarioFile], mission: ScenarioFile) -> ScenarioFile:
    """The mission with this kind among its dispersions, drawn as a Latin hypercube."""
    kept = [entry for entry in mission.dispersions if entry.name != ENTRY["key"]]
    return scenario_loader.validate(file(*kept, ENTRY).model_dump() | {"design": {"kind": "latin_hypercube"}})


def quarters_of(masses_kg: np.ndarray) -> list[float]:
    """Quarter of the distribution of each value, sorted."""
    return sorted(np.floor(4.0 * triang(0.5, MASS_KG - ENTRY["half_width"], 2.0 * ENTRY["half_width"]).cdf(masses_kg)))


def test_a_design_draws_one_value_from_each_quarter(file: Callable[..., ScenarioFile], mission: ScenarioFile) -> None:
    planned = dry_run.plan_campaign(of_a_design(file, mission), CampaignOptions(4, 5))
    assert quarters_of(planned.values["servicer.mass_kg"]) == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.slow
def test_runs_of_a_design_are_simulated_with_its_values(
    file: Callable[..., ScenarioFile], mission: ScenarioFile, tmp_path: Path
) -> None:
    campaign = run_campaign(of_a_design(file, mission), 4, tmp_path / "out", seed=5, histories=[])
    drawn = campaign.drawn["servicer.mass_kg"]
    np.testing.assert_allclose(campaign.used["servicer.mass_kg"], drawn, rtol=1e-13)
    assert quarters_of(drawn) == [0.0, 1.0, 2.0, 3.0]


def test_independent_runs_have_its_distribution(file: Callable[..., ScenarioFile]) -> None:
    scenario = file(ENTRY)
    drawn = draw(scenario, np.arange(1000))
    [marginal] = drawn_marginals(scenario.model_dump(mode="json"), drawn)
    assert marginal.distribution is not None
    assert goodness_of_fit_p(marginal.values, marginal.distribution) > 1e-3


def test_it_has_a_standard_normal_variable_and_a_linearisation(file: Callable[..., ScenarioFile]) -> None:
    space = standard_normal_space.make_space(file(ENTRY))
    assert space.labels == space.groups == ("servicer.mass_kg",)
    assert space.values_at(jnp.zeros(1), jnp.zeros(2, dtype=jnp.uint32))["servicer.mass_kg"] == MASS_KG
    found = linearise_dispersions(space.file)
    assert found.mean["servicer.mass_kg"] == MASS_KG
    np.testing.assert_allclose(found.columns["servicer.mass_kg"]["servicer.mass_kg"], [[triang(0.5, 0.0, 4.0).std()]])
