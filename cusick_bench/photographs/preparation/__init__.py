"""From a folder of photographs to a data set in the project's layout."""
