"""The page of a diagnosis.

page: `write_diagnosis_page`; causes, place, before_after, profiles, steps: its sections; graphs, words, values:
how they are drawn, worded and read; template: its HTML.
"""
