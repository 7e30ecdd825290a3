"""Adversaries psi(a|s): the actions of a bad demonstrator in a state."""
