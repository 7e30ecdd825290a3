"""Data larger than memory: engines that run passes, and fits from sums over passes."""
