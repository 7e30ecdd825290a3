"""Segments: where in a demonstration something is, and which rows to keep."""
