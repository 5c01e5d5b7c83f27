"""Changed keys of two scenarios."""

from rpojax.analysis.statistics.campaign_comparison import KeyChange, changed_keys


def test_changed_keys_are_found_at_any_depth_and_on_either_side() -> None:
    one = {"a": {"b": 1, "c": [1, 2]}, "d": 4}
    other = {"a": {"b": 1, "c": [1, 3]}, "e": 5}
    assert changed_keys(one, other) == (
        KeyChange("a.c", [1, 2], [1, 3]),
        KeyChange("d", 4, None),
        KeyChange("e", None, 5),
    )
