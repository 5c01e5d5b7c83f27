"""Surface of a target as facets: making of facets, ray casting, and visibility of each from any direction."""
