"""Orbital mechanics used by truth and flight software: gravity, relative motion, Sun and Moon, eclipse."""
