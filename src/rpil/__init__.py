"""Robust probabilistic imitation learning."""

__version__ = "0.1.0"
