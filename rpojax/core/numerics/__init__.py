"""Numerical methods: Runge-Kutta, exact differences, double-single numbers, gradient-safe primitives."""
