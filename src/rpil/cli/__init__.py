"""The command `rpil`; nothing is imported here, so that it starts fast."""
