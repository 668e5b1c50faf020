"""The page of a results folder.

page: `write_report`; content: what it holds; figure: the same pictures as a file. Its HTML: `report/templates`.
"""
