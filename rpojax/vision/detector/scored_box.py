"""Bounding box with a score, on the host."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class ScoredBox:
    """Left, top, right, bottom [px], and score in 0..1."""

    left: float
    top: float
    right: float
    bottom: float
    score: float

    @property
    def area(self) -> float:
        """Area [px^2]."""
        return max(self.right - self.left, 0.0) * max(self.bottom - self.top, 0.0)

    def intersection_area(self, other: "ScoredBox") -> float:
        """Area [px^2] that two boxes share."""
        width = min(self.right, other.right) - max(self.left, other.left)
        height = min(self.bottom, other.bottom) - max(self.top, other.top)
        return max(width, 0.0) * max(height, 0.0)

    def intersection_over_union(self, other: "ScoredBox") -> float:
        """Intersection over union."""
        intersection = self.intersection_area(other)
        return intersection / max(self.area + other.area - intersection, 1e-9)
