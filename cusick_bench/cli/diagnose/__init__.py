"""Commands of the diagnosis and of withheld cases."""
