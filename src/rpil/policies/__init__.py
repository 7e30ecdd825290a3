"""Policies pi(a|s): the actions of an expert in a state, and the features that a policy sees."""
