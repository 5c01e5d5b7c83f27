"""`vmap` over the last axis of every array, so that compiled loops run over the batch."""
