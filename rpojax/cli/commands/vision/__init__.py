"""Commands for radiance fields, the detector and the camera model."""
