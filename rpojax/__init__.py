"""rpojax: differentiable, batched Monte Carlo simulation of vision-based rendezvous and proximity operations."""

__version__ = "0.1.0"
