"""Outline of the target from its sizes or a mesh: hull, mass properties, and what the filter should believe of it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist

from rpojax.core.numerics.fibonacci_sphere import fibonacci_sphere
from rpojax.errors import RpojaxError
from rpojax.scenario.own_mission.choices import Choice, Choices, tidy, tidy_all
from rpojax.scenario.own_mission.facts import MissionFacts
from rpojax.scenario.trained.packaged_hull import packaged_hull
from rpojax.scenario.warnings.target_size import largest_side_log, mean_size, size_spread
from rpojax.training.synthetic_data.meshes.mesh_files import load_mesh

_MASS_OF_A_CUBIC_METRE_KG = 190.0
_MASS_POWER = 0.75
_PANEL_WIDTH = 0.88
"""Of panels over that of the body, as those of the packaged target."""
_PANEL_MASS = 0.15
"""Share of the target's mass."""
_SEEN_FROM = 5000
_FAR = 50.0
"""Distance from which the offset by perspective is judged, in sizes of the target."""
_LEAST_DISTANCE = 0.6
"""Distance of the last station over the diameter of the target: a fifth more than its half, which turns."""
_DIRECTIONS = 48
"""Directions in which a mesh's outline is kept."""
_CORNERS = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
"""Of a cube of side 2."""


def mass_of_volume(volume_m3: float) -> float:
    """Mass [kg] of a usual spacecraft of a volume [m^3]: small ones are denser."""
    return _MASS_OF_A_CUBIC_METRE_KG * volume_m3**_MASS_POWER


def side_of_mass(mass_kg: float) -> float:
    """Side [m] of the cube that a usual spacecraft of a mass fills."""
    return (mass_kg / _MASS_OF_A_CUBIC_METRE_KG) ** (1.0 / (3.0 * _MASS_POWER))


MASS_RULE = f"{_MASS_OF_A_CUBIC_METRE_KG:g} kg times volume in m3 to the {_MASS_POWER:g}"


@dataclass(frozen=True)
class Outline:
    """Target as the mission needs it.

    Attributes:
        hull_m: (points, 3) in T
        sides_m: of its body
        diameter_m: between the two points that are farthest from each other
        size_m: geometric mean of the root of width times height over all attitudes
        words: what it is
    """

    hull_m: np.ndarray
    sides_m: tuple[float, float, float]
    diameter_m: float
    size_m: float
    words: str


def outline_of(facts: MissionFacts) -> Outline:
    """Outline of the target of a mission.

    Raises:
        RpojaxError: the mesh cannot be used, or a station is within the target's reach.
    """
    outline = _outline(facts)
    if facts.nearest_m <= _LEAST_DISTANCE * outline.diameter_m:
        name = "hold_m" if facts.approach_m is None else "approach_m"
        least = f"more than {_LEAST_DISTANCE * outline.diameter_m:.3g}, {_LEAST_DISTANCE:g} times the target's"
        expected = f"{least} {outline.diameter_m:.3g} m from corner to corner"
        raise RpojaxError.of_argument(name, f"found {facts.nearest_m:g}, expected {expected}")
    return outline


def _outline(facts: MissionFacts) -> Outline:
    if facts.target_mesh is not None:
        hull, sides = _hull_of_mesh(facts)
        words = (
            f"the mesh {Path(facts.target_mesh).name}, {' x '.join(f'{each:.3g}' for each in np.ptp(hull, axis=0))} m"
        )
    else:
        sides = facts.sides_m
        hull, words = _box_with_panels(sides, facts.span_m)
    return Outline(hull, sides, float(pdist(hull).max()), mean_size(hull.tolist()), words)


def target_choices(facts: MissionFacts, outline: Outline, base: Mapping[str, Any]) -> Choices:
    """Keys of the target and of what the filter believes of its outline, by the `navigation` of the `base`."""
    return Choices([*_mass_properties(facts, outline), *_beliefs(facts, outline, base)], _dispersions(facts))


def _box_with_panels(sides: tuple[float, float, float], span_m: float | None) -> tuple[np.ndarray, str]:
    half = 0.5 * np.array(sides)
    corners = half * _CORNERS
    words = "a body of " + " x ".join(f"{each:g}" for each in sides) + " m"
    if span_m is None:
        return corners, words
    tips = [[a * _PANEL_WIDTH * half[0], b * 0.5 * span_m, 0.0] for a in (-1, 1) for b in (-1, 1)]
    return np.concatenate([corners, tips]), f"{words} and {span_m:g} m across its panels"


def _hull_of_mesh(facts: MissionFacts) -> tuple[np.ndarray, tuple[float, float, float]]:
    """Outermost points of a mesh in directions all round, and the sides of a box of its hull's volume."""
    assert facts.target_mesh is not None
    mesh = load_mesh(facts.target_mesh, facts.mesh_units)
    directions = np.concatenate([fibonacci_sphere(_DIRECTIONS).T, np.eye(3), -np.eye(3), _CORNERS])
    kept = np.unique(mesh.vertices[np.argmax(directions @ mesh.vertices.T, axis=1)], axis=0)
    try:
        volume = float(ConvexHull(kept).volume)
    except QhullError:
        found = f"found {facts.target_mesh}, whose points lie in a plane, expected a body"
        raise RpojaxError.of_argument("target_mesh", found) from None
    box = np.ptp(kept, axis=0)
    sides = box * (volume / float(np.prod(box))) ** (1.0 / 3.0)
    return np.round(kept, 4), (float(sides[0]), float(sides[1]), float(sides[2]))


def target_area_and_mass(facts: MissionFacts, outline: Outline) -> tuple[float, float]:
    """Mean cross-section of the target over all attitudes [m^2], and its mass [kg]."""
    a, b, c = outline.sides_m
    area = 0.5 * (a * b + b * c + c * a)
    if facts.span_m is not None:
        area += 0.5 * _PANEL_WIDTH * a * (facts.span_m - b)
    return area, facts.target_mass_kg or tidy(mass_of_volume(a * b * c), 2)


def _mass_properties(facts: MissionFacts, outline: Outline) -> list[Choice]:
    a, b, c = outline.sides_m
    area, mass = target_area_and_mass(facts, outline)
    squares = np.array(outline.sides_m) ** 2
    inertia, reason = mass / 12.0 * (squares.sum() - squares), "of the body"
    if facts.span_m is not None:
        arm = 0.25 * (facts.span_m + b)
        inertia += _PANEL_MASS * mass * arm**2 * np.array([1.0, 0.0, 1.0])
        reason += f", and panels of {_PANEL_MASS:g} of the mass {arm:.3g} m from the middle"
    return [
        Choice("target.mass_kg", mass, "" if facts.target_mass_kg else f"{MASS_RULE}, here {a * b * c:.3g} m3", True),
        Choice("target.inertia_kg_m2", tidy_all(np.diag(inertia)), reason),
        Choice("target.hull_m", tidy_all(outline.hull_m, 4), outline.words),
        Choice("target_surface.area_m2", tidy(area), "mean over all attitudes, half of each side of panels", True),
        Choice(
            "target_surface.center_of_pressure_m",
            tidy_all(np.array([0.02, 0.0, 0.01]) * outline.size_m),
            f"2 % of the size of {outline.size_m:.3g} m",
            True,
        ),
    ]


def _beliefs(facts: MissionFacts, outline: Outline, base: Mapping[str, Any]) -> list[Choice]:
    spread, packaged = size_spread(outline.hull_m.tolist()), size_spread(packaged_hull().tolist())
    factor = spread / packaged
    offset, perspective = _middles(outline)
    side, side_spread = largest_side_log(outline.hull_m.tolist())
    center = math.hypot(offset, base["center_sigma_m"] * outline.size_m / base["target_size_m"])
    return [
        Choice(
            "navigation.target_size_m", tidy(outline.size_m, 4), "geometric mean of sqrt(width height) over attitudes"
        ),
        *_size_belief(facts),
        Choice(
            "navigation.scale_sigma",
            tidy_all([each * factor for each in base["scale_sigma"]]),
            f"the log of the size has a spread of {spread:.3g} over attitudes, that of `inspection` {packaged:.3g}",
        ),
        Choice(
            "navigation.largest_side_log",
            tidy_all([side, side_spread]),
            "log of the larger side over the size: mean and spread over attitudes",
        ),
        Choice(
            "navigation.center_sigma_m", tidy(center, 2), f"middle of the outline {offset:.2g} m off, and 0.2 % of size"
        ),
        Choice("navigation.center_perspective", tidy(perspective), "near parts look greater: of the hull, all round"),
    ]


def _size_belief(facts: MissionFacts) -> list[Choice]:
    if facts.size_sigma == 0.0:
        return []
    # The log of the least size that a normal error of three sigma reaches.
    sigma = tidy(-math.log(1.0 - 3.0 * facts.size_sigma) / 3.0)
    return [Choice("navigation.target_size_sigma", sigma, f"of its log, to {facts.size_sigma:g} of it")]


def _middles(outline: Outline) -> tuple[float, float]:
    """Offset of the outline's middle from the centre of mass [m], and what perspective adds, over size squared [m]."""
    q, r = np.linalg.qr(np.random.default_rng(0).normal(size=(_SEEN_FROM, 3, 3)))
    seen = outline.hull_m @ (q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :])

    def middle(points: np.ndarray) -> np.ndarray:
        return 0.5 * (points.max(axis=1) + points.min(axis=1))

    far = _FAR * outline.size_m
    flat = middle(seen[:, :, :2])
    near_parts = middle(seen[:, :, :2] * far / (far + seen[:, :, 2:])) - flat
    return float(flat.std()), float(near_parts.std() * far / outline.size_m**2)


def _dispersions(facts: MissionFacts) -> list[Choice]:
    tumble = facts.tumble_deg_s
    found = [
        Choice(
            "dispersions",
            {
                "key": "target.tumble_rate_deg_s",
                "kind": "uniform",
                "low": tidy(0.8 * tumble),
                "high": tidy(1.2 * tumble),
            },
            f"a fifth about {tumble:g} deg/s",
        )
    ]
    if tumble == 0.0:
        found = [Choice("dispersions", {"key": "target.tumble_rate_deg_s", "kind": "none"}, "no tumble")]
    if facts.size_sigma > 0.0:
        entry = {"key": "target.scale", "kind": "normal", "sigma": facts.size_sigma}
        found.append(Choice("dispersions", entry, "as the belief of the size"))
    return found
