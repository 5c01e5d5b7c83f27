"""Decisions about burns and phases, from what navigation knows: the flight computer asks for them tick by tick."""
