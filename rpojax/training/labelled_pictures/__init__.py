"""Pictures with labels: annotations in COCO's format, pictures as squares, faults, and labels that are implausible."""
