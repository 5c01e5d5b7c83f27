"""Reading of untrusted files: regular files alone, never blocking, of limited size, depth and number of keys."""
