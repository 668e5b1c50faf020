"""Graphs of the page of a diagnosis, and the drapes of data and models that they show."""
