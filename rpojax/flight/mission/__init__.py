"""Missions of several phases: the phase table, the mission manager, aborts and the burn veto."""
