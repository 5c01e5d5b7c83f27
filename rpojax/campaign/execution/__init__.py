"""How the blocks of a campaign are simulated: in this process, in worker processes, or on a Dask cluster."""
