"""Simulated demonstrations: environments, experts, corruptions, rollouts."""
