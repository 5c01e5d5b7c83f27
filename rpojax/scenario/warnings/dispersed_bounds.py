"""Warning about dispersions without bounds that draw what the schema does not allow."""

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.scenario.dispersed_numbers.assigned_value_checks import CATEGORICAL_KEYS, check_acceptable
from rpojax.scenario.dispersed_numbers.dispersion_keys import assigned_keys
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach


def bound_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """One line for each dispersed number that three sigma lead to where it cannot be, such as a negative mass."""
    found = []
    for index, dispersion in enumerate(file.dispersions):
        for text, parameter in zip(dispersion.key_texts, assigned_keys(dispersion), strict=True):
            if text in CATEGORICAL_KEYS:
                continue
            for value in reach.ends(text):
                try:
                    check_acceptable(
                        file, f"dispersions.{index}", parameter, value.tolist(), False, np.round(value, 9).tolist()
                    )
                except ScenarioError as error:
                    found.append(f"{error}; some runs are simulated with such a value")
                    break
    return found
