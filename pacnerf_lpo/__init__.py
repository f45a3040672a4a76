"""PAC-NeRF with Lagrangian Particle Optimization: shape, appearance and material from a few videos."""

__version__ = "0.1.0"
