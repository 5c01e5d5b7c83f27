"""From radiance to pictures: background, exposure, image files, contact sheets."""
