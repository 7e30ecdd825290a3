"""The command `rpil`."""
