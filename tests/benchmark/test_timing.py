"""Timing of repeated work."""

from rpojax.benchmark import timing
from rpojax.benchmark.timing import ElapsedTime


def test_fastest_pass_leaves_out_the_first() -> None:
    passes = iter([ElapsedTime(1.0, 1.0), ElapsedTime(3.0, 5.0), ElapsedTime(2.0, 4.0), ElapsedTime(4.0, 3.0)])
    assert timing.fastest_pass(lambda: next(passes), 3) == ElapsedTime(2.0, 4.0)
    assert next(passes, None) is None
