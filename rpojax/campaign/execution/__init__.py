"""Batched simulation of the blocks of a campaign: in this process, in worker processes, or on a Dask cluster."""
