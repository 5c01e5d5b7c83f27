"""Assertion on the message of a scenario error."""

from rpojax.errors import ScenarioError


def assert_one_line(error: ScenarioError, key: str, *words: str) -> None:
    """Asserts that the message is one line that begins with the key and names what was expected."""
    message = str(error)
    assert "\n" not in message
    assert message.startswith((f"{key}: found ", f"{key}: missing, "))
    assert ", expected " in message
    expected = message.split(", expected ", 1)[1]
    for word in words:
        assert word in expected, message
