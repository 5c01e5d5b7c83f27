"""Hash of a scenario, by which campaigns of the same runs are recognised."""

import hashlib
import json

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.trained import trained_files


def scenario_digest(file: ScenarioFile) -> str:
    """SHA-256 of everything in a scenario that can change a number of a run, trained files included.

    Name, description, requirements and the weights of tuning cannot.
    """
    content = file.model_dump(mode="json", exclude={"name", "description", "requirements", "tuning"})
    if file.design.kind == "independent":
        del content["design"]
    elif file.design.kind == "grid":
        # The order of the keys decides which run has which combination.
        content["design"]["values"] = list(content["design"]["values"].items())
    if file.precision == "double":
        # Campaigns recorded before these keys existed keep their digest.
        del content["precision"]
    if file.target.scale == 1.0:
        del content["target"]["scale"]
    if trained := trained_files.required_digests(content):
        content["trained"] = trained
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
