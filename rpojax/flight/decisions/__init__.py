"""Decisions about burns and phases on decision ticks, from what navigation knows and how both spacecraft move on."""
