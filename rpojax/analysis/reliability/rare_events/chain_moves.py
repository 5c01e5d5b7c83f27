"""Moves of Markov chains that keep the nominal distribution: preconditioned Crank-Nicolson, and redrawn noise keys.

The step of each coordinate follows the spread of the points at hand, and a common factor follows the acceptance
(adaptive conditional sampling; Papaioannou, Betz, Zwirglmaier and Straub 2015).
"""

from dataclasses import dataclass, field

import numpy as np

from rpojax.analysis.reliability.rare_events.latent_points import KEY_LIMIT, LatentPoints

_TARGET_ACCEPTANCE = 0.44
_KEY_MOVE_SHARE = 0.5
"""Share of the moves that redraw noise keys, where there are any, and leave the normal numbers."""


@dataclass
class ChainMoves:
    """Proposals of chains, adapted to their acceptance.

    Attributes:
        deviations: (k,) spread of the points, in units of the nominal scale
        scale: of the distribution that the moves keep
        factor: on `deviations`
        key_share: expected share of the noise keys that a move redraws
        proposed: moves so far
        accepted: of them
    """

    deviations: np.ndarray
    scale: float = 1.0
    factor: float = 0.8
    key_share: float = 0.5
    proposed: int = 0
    accepted: int = 0
    _turns: int = field(default=0)

    @property
    def acceptance(self) -> float:
        """Share of accepted moves."""
        return self.accepted / max(1, self.proposed)

    def propose(self, rng: np.random.Generator, points: LatentPoints) -> tuple[LatentPoints, np.ndarray]:
        """Proposals, and flags (n,) of those that redraw noise."""
        count, blocks = len(points), points.keys.shape[1]
        step = np.minimum(1.0, self.factor * self.deviations)
        moved = np.sqrt(1.0 - step**2) * points.x + step * self.scale * rng.standard_normal(points.x.shape)
        if blocks == 0:
            return LatentPoints(moved, points.keys), np.zeros(count, dtype=bool)
        redraws = rng.random(count) < _KEY_MOVE_SHARE
        chosen = rng.random(points.keys.shape) < self.key_share
        chosen[np.arange(count), rng.integers(0, blocks, count)] = True
        fresh = rng.integers(1, KEY_LIMIT, points.keys.shape, dtype=np.uint32)
        keys = np.where(chosen & redraws[:, None], fresh, points.keys)
        return LatentPoints(np.where(redraws[:, None], points.x, moved), keys), redraws

    def adapt(self, accepted: np.ndarray, redraws: np.ndarray) -> None:
        """Follows the acceptance (n,) of proposals, of which some redrew noise."""
        self._turns += 1
        gain = 1.0 / np.sqrt(self._turns)
        self.proposed += len(accepted)
        self.accepted += int(accepted.sum())
        for which, name in ((~redraws, "factor"), (redraws, "key_share")):
            if which.any():
                change = gain * (accepted[which].mean() - _TARGET_ACCEPTANCE)
                setattr(self, name, float(np.clip(getattr(self, name) * np.exp(change), 1e-3, 3.0)))
        self.key_share = min(self.key_share, 1.0)


def spread(x: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) of points (n, k), never zero."""
    return np.maximum(np.std(x, axis=0), 1e-2) if len(x) > 1 else np.ones(x.shape[1])
