"""Cholesky factor of a positive semidefinite matrix."""

import numpy as np

_RELATIVE_TOLERANCE = 1e-9


def cholesky_factor(covariance: np.ndarray) -> np.ndarray:
    """Lower triangular (n, n) factor L with `L L' = covariance`.

    A conditional variance below a relative tolerance, which rounding leaves of a singular matrix, counts as zero.
    """
    variance = np.diag(covariance)
    factor = np.zeros_like(covariance)
    for column in range(len(covariance)):
        rest = covariance[column:, column] - factor[column:, :column] @ factor[column, :column]
        if rest[0] > _RELATIVE_TOLERANCE * variance[column]:
            factor[column:, column] = rest / np.sqrt(rest[0])
    return factor
