"""The recursion over spans against a recursion tick by tick, and against the double integrator."""

import numpy as np
import pytest

from rpojax.analysis.linear_covariance.nominal_recursion import CovarianceRecursion, TickSystem

SIZE, INPUTS, OUTPUTS, COLUMNS = 5, 3, 2, 4
NOISE_SOURCE = np.array([0, 0, 1])
NONE = np.zeros((SIZE, 0)), np.zeros(0, dtype=int)


def system(rng: np.random.Generator, ticks: int) -> list[TickSystem]:
    """A stable time-varying system with all kinds of noise."""
    found = []
    for index in range(ticks):
        forcing = np.zeros((INPUTS, COLUMNS))
        forcing[0, 2:] = rng.normal(size=2)
        added = (rng.normal(size=(SIZE, 2)), np.array([2, 1])) if index == 3 else NONE
        before = (rng.normal(size=(SIZE, 1)), np.array([2])) if index == 7 else NONE
        A = 0.5 * rng.normal(size=(SIZE, SIZE))
        B, D = rng.normal(size=(SIZE, INPUTS)), rng.normal(size=(OUTPUTS, INPUTS))
        found.append(TickSystem(A, B, rng.normal(size=(OUTPUTS, SIZE)), D, forcing, *added, *before))
    return found


def test_spans_of_any_length_agree_with_the_recursion_tick_by_tick() -> None:
    rng = np.random.default_rng(0)
    start = rng.normal(size=(SIZE, COLUMNS))
    ticks = system(rng, 12)
    columns, noise = start.copy(), np.zeros((3, SIZE, SIZE))
    covariances, shares = [], []
    for tick in ticks:
        for column, source in zip(tick.before.T, tick.before_source, strict=True):
            noise[source] += np.outer(column, column)
        outputs = tick.C @ columns + tick.D @ tick.forcing
        by_source = np.array([np.diag(tick.C @ part @ tick.C.T) for part in noise])
        for column, source in zip(tick.D.T, NOISE_SOURCE, strict=True):
            by_source[source] += column**2
        shares.append((outputs**2, by_source))
        covariances.append(outputs @ outputs.T + tick.C @ noise.sum(axis=0) @ tick.C.T + tick.D @ tick.D.T)
        columns = tick.A @ columns + tick.B @ tick.forcing
        noise = tick.A @ noise @ tick.A.T
        for gains, sources in ((tick.B, NOISE_SOURCE), (tick.added, tick.added_source)):
            for column, source in zip(gains.T, sources, strict=True):
                noise[source] += np.outer(column, column)
    for span in (1, 4, 12):
        recursion = CovarianceRecursion(columns=start, noise=np.zeros((3, SIZE, SIZE)), noise_source=NOISE_SOURCE)
        for index, tick in enumerate(ticks):
            if index % span == 0:
                for found, expected in zip(recursion.variance_shares(tick), shares[index], strict=True):
                    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(recursion.step(tick), covariances[index], rtol=1e-10)
            if (index + 1) % span == 0:
                recursion.end_span()
        np.testing.assert_allclose(recursion.columns, columns, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(recursion.noise, noise, rtol=1e-9, atol=1e-12)


def test_the_double_integrator_has_its_analytic_variances() -> None:
    # White acceleration a_k, x' = x + v, v' = v + a: after n ticks var v = n and var x = (n - 1) n (2 n - 1) / 6.
    recursion = CovarianceRecursion(columns=np.zeros((2, 1)), noise=np.zeros((1, 2, 2)), noise_source=np.array([0]))
    A, B = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.0], [1.0]])
    none = np.zeros((2, 0)), np.zeros(0, dtype=int)
    tick = TickSystem(A, B, np.eye(2), np.zeros((2, 1)), np.zeros((1, 1)), *none, *none)
    for count in range(30):
        position, velocity = np.diag(recursion.step(tick))
        assert velocity == pytest.approx(count)
        assert position == pytest.approx((count - 1) * count * (2 * count - 1) / 6.0)
        if count % 7 == 6:
            recursion.end_span()
