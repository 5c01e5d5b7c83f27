"""Numerical methods: exact differences, double-single numbers, Runge-Kutta, gradient-safe primitives."""
