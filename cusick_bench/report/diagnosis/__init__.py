"""The page of a diagnosis.

page: `write_diagnosis_page`; verdict, gap, place, causes, statistics, before_after, budget, next_steps: its sections;
bars, cloth_map, profile_graphs: their graphs; profiles: drapes of data and models; words, effect_words, number_format,
named_causes: how things are said. Its HTML: `report/templates`.
"""
