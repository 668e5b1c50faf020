"""Sections of the page of a diagnosis, each with what its part of the template shows."""
