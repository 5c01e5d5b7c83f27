"""Orbits as truth and flight software both need them: gravity, relative motion, Sun and Moon, eclipse."""
