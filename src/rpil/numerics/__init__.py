"""Numerics: passes over blocks of rows, Newton steps, weighted regression, threads."""
