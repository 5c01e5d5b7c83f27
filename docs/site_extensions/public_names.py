"""The public names of the package, grouped, as directives of autodoc, which takes signatures and docstrings."""

from collections.abc import Iterator

GROUPS = {
    "Scenarios": ("load", "ScenarioFile", "Scenario", "Params", "nominal_parameters"),
    "One run": ("simulate", "initialise_run", "init", "run_key", "step", "rollout", "State", "Telemetry"),
    "Campaigns": ("run_campaign", "resume_campaign", "Campaign", "open_campaign", "Retention", "Shard", "RunRange"),
    "Reports and exports": ("write_report", "compare", "export"),
    "Analyses": (
        "gradient",
        "sensitivity",
        "tune",
        "linear_covariance",
        "worst_case",
        "estimate_probability",
        "robustness",
    ),
    "Flight software and plugins": ("Stages", "Plugin", "metric", "AdditionalSensor"),
    "The process": ("prepare_process", "RpojaxError"),
}
"""Heading -> names; together all of `rpojax.__all__` but the version, which a test checks."""

_ATTRIBUTES_ARE_FIELDS = {"Scenario", "Params", "State", "Telemetry", "ScenarioFile"}
"""Records with so many fields that pages of their own describe them; they are shown without a signature."""


def lines() -> Iterator[str]:
    """Markdown with a directive of autodoc for each name."""
    import rpojax

    for heading, names in GROUPS.items():
        yield from (f"## {heading}", "")
        for name in names:
            found = getattr(rpojax, name)
            kind = "autoclass" if isinstance(found, type) else "autofunction"
            fields = name in _ATTRIBUTES_ARE_FIELDS
            yield from ("```{eval-rst}", f".. {kind}:: rpojax.{name}{'()' if fields else ''}")
            if kind == "autoclass" and not fields:
                yield "   :members:"
            yield from ("```", "")
