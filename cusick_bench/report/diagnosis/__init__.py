"""The page of a diagnosis: page -> sections -> graphs -> wording.

page: `write_diagnosis_page`; sections: verdict, gap, place, causes, statistics, before and after, budget, next steps;
graphs: their graphs, and the drapes of data and models in them; wording: how things are said. Its HTML:
`report/templates`.
"""
