"""Committed result tables, one CSV file a track; each row names the command, data and code that made it."""
