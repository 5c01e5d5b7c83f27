"""Formats of mesh files, one module each: what of a file is used, refused, or noted as not used."""
