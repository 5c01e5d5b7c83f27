"""Arrays of a campaign folder in the Zarr 3 format: encoding, writing of whole files, reading with verification."""
