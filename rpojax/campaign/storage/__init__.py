"""The campaign folder: campaign.json, block manifests, Zarr arrays, and their verified reading."""
