"""Guidance of a team: what each servicer knows of the others' motion and plans, and what it makes of it."""
