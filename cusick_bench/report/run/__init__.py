"""The page of a results folder.

page: `write_report`; content: what it holds; template: its HTML; figure: the same pictures as a file.
"""
