"""The command `rpil`; nothing is imported here, so that it starts fast."""

INTERRUPTED = 130
"""The exit code after an interruption, as shells have it."""
