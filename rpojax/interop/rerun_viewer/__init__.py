"""Recordings for the rerun viewer: 3-D scene, camera and plots."""
