"""Evaluation of many rows in parts, in threads."""

import threading

import numpy as np
import pytest

from rpojax.runtime import rows_in_parts
from rpojax.runtime.rows_in_parts import in_parts


@pytest.mark.parametrize(("first", "last", "parts"), [(0, 5, 1), (100, 612, 1), (100, 613, 2), (7, 2100, 5)])
def test_parts_join_to_all_rows_in_order(first: int, last: int, parts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows_in_parts, "available_cores", lambda: 3)
    values = np.random.default_rng(1).normal(size=(2200, 2))
    seen: list[slice] = []

    def squares(rows: slice) -> dict[str, np.ndarray]:
        seen.append(rows)
        return {"square": values[rows] ** 2, "number": np.arange(rows.start, rows.stop)}

    found = in_parts(squares, slice(first, last))
    np.testing.assert_array_equal(found["square"], values[first:last] ** 2)
    np.testing.assert_array_equal(found["number"], np.arange(first, last))
    assert len(seen) == parts
    assert max(rows.stop - rows.start for rows in seen) <= 512


def test_parts_run_at_the_same_time_and_an_error_of_one_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows_in_parts, "available_cores", lambda: 2)
    both = threading.Barrier(2, timeout=60.0)

    def meet(rows: slice) -> dict[str, np.ndarray]:
        both.wait()
        if rows.start:
            raise ValueError("of the second part")
        return {"row": np.arange(rows.start, rows.stop)}

    with pytest.raises(ValueError, match="of the second part"):
        in_parts(meet, slice(0, 1000))
