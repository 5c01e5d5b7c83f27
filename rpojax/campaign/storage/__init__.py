"""The campaign folder: configuration, block manifests, Zarr arrays written whole and read with verification."""
