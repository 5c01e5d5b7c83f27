"""Missions of several phases in the report: when phases began and how they ended, their figures, and aborts."""
