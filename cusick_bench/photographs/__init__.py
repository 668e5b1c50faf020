"""Photographs of drapes: from phone pictures to silhouettes in the layout of a data set."""
