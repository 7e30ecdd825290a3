"""Data: demonstrations in memory and on disk, their actions, and the files they come from."""
