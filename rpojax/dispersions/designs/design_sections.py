"""Schema of the `[design]` of a scenario: how the dispersed numbers are distributed over the runs of a campaign."""

from typing import Annotated, Literal

from pydantic import Field

from rpojax.physics.plant_options import FaultKind
from rpojax.value_types import Finite, Section


class IndependentDesign(Section):
    """Independent random samples."""

    kind: Literal["independent"]


class LatinHypercubeDesign(Section):
    """Latin hypercube: stratified samples of every dispersed number."""

    kind: Literal["latin_hypercube"]


class SobolDesign(Section):
    """Scrambled Sobol sequence over all dispersed numbers."""

    kind: Literal["sobol"]


class TableDesign(Section):
    """Listed values of some keys for each run; loading replaces the CSV `file` by its `values`."""

    kind: Literal["table"]
    file: str = ""
    values: dict[str, list[Finite] | list[FaultKind]] = Field(default_factory=dict)


class GridDesign(Section):
    """Full factorial grid: every combination of listed values of some keys; the last key varies fastest."""

    kind: Literal["grid"]
    values: Annotated[
        dict[str, Annotated[list[Finite] | list[list[Finite]] | list[FaultKind], Field(min_length=1)]],
        Field(min_length=1, max_length=64),
    ]


Design = Annotated[
    IndependentDesign | LatinHypercubeDesign | SobolDesign | TableDesign | GridDesign, Field(discriminator="kind")
]
