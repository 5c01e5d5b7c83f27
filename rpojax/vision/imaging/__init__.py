"""Image formation: background, exposure, sRGB, image files, contact sheets and videos."""
